# SPDX-License-Identifier: GPL-3.0-or-later
"""A viewport shows what a render with Network and Rays shows, coarse to fine, and does nothing twice."""
import itertools

import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.metrics.scores import psnr
from bl_ext.user_default.renderformer_v2.rf2_engine.convert import compute
from bl_ext.user_default.renderformer_v2.rf2_engine.frame.shot import has_left
from bl_ext.user_default.renderformer_v2.rf2_engine.viewport import pictures as viewport_pictures
from bl_ext.user_default.renderformer_v2.rf2_engine.viewport import session as sessions
from bl_ext.user_default.renderformer_v2.rf2_engine.viewport.session import Request, Session

from tests.rf2_engine.f12 import cube, material, mesh_object, press_f12, sun
from tests.rf2_engine.viewport.views import finished, pictures, read, request, through_camera

WIDTH, HEIGHT = 256, 128


@pytest.fixture
def corner(scene):
    """A red cube on a floor in the sun."""
    cube(scene, of=material("Red", (0.8, 0.05, 0.05))).rotation_euler = (0.3, 0.2, 0.5)
    mesh_object(scene, "Floor", [(-4, -3, -1.4), (4, -3, -1.4), (4, 6, -1.4), (-4, 6, -1.4)], [(0, 1, 2, 3)])
    sun(scene)
    scene.renderformer_v2.light = "NETWORK"
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    return scene


@pytest.fixture
def counted(monkeypatch):
    """How often a scene was made ready, and pictures of which size were drawn."""
    calls = {"light": 0, "picture": []}

    def light(*given, real=viewport_pictures.prepare_scene):
        calls["light"] += 1
        return real(*given)

    def picture(lit, view, *rest, real=viewport_pictures.render_picture):
        calls["picture"].append((view.width, view.height))
        return real(lit, view, *rest)
    monkeypatch.setattr(sessions, "prepare_scene", light)
    monkeypatch.setattr(sessions, "render_picture", picture)
    return calls


def submit(session, scene, source, view):
    return session.submit(request(scene, source, view))


def smaller(picture, like):
    """A picture as large as another one, whose sides divide its own: means of its pixels."""
    (height, width), (high, wide) = picture.shape[:2], like.shape[:2]
    return picture.reshape(high, height // high, wide, width // wide, -1).mean(axis=(1, 3))


def test_each_level_shows_what_a_render_with_network_alone_shows(corner, tmp_path):
    corner.renderformer_v2.guide_samples = 8
    rendered = press_f12(corner, tmp_path)["ViewLayer.Combined"]
    session = Session()
    submit(session, corner, read(), through_camera(corner, WIDTH, HEIGHT))
    shown = [picture for picture in pictures(session) if picture]
    assert [picture.divisor for picture in shown] == [8, 4, 2, 1]
    close = [psnr(picture.pixels[..., :3], smaller(rendered, picture.pixels)[..., :3]) for picture in shown]
    assert close[-1] > 30 and min(close) > 20


def test_the_first_picture_does_not_wait_for_the_network(corner, monkeypatch):
    drawn = []

    def picture(lit, view, look, divisor, real=viewport_pictures.render_picture):
        drawn.append((divisor, lit.is_draft))
        return real(lit, view, look, divisor)
    monkeypatch.setattr(sessions, "render_picture", picture)
    corner.renderformer_v2.viewport.resolution = "4"
    session, source = Session(), read()
    submit(session, corner, source, through_camera(corner, WIDTH, HEIGHT))
    pictures(session)
    assert drawn == [(8, True), (4, False)]
    corner.renderformer_v2.viewport.resolution = "8"
    session = Session()
    submit(session, corner, source, through_camera(corner, WIDTH, HEIGHT))
    pictures(session)
    assert drawn[2:] == [(8, True), (8, False)]
    corner.renderformer_v2.viewport.resolution = "1"
    session = Session()
    submit(session, corner, source, through_camera(corner, WIDTH, HEIGHT))
    pictures(session)
    assert drawn[4:] == [(8, True), (4, True), (2, False), (1, False)]


def test_surfaces_are_shown_without_light_until_there_is_a_picture(corner, monkeypatch):
    session, source = Session(), read()
    view, shown = through_camera(corner, WIDTH, HEIGHT), []
    monkeypatch.setattr(sessions, "prepare_scene", lambda *given, real=sessions.prepare_scene: (
        shown.append(session.sketch), real(*given))[1])
    submit(session, corner, source, view)
    assert pictures(session)
    (sketch,), last = shown, session.displayed.pixels
    assert session.sketch is None and sketch.pixels[..., 3].all()
    close = psnr(sketch.pixels[..., :3], smaller(last, sketch.pixels)[..., :3])
    red = sketch.pixels[..., 0] > 3 * sketch.pixels[..., 1]
    assert close > 8 and red.any() and (smaller(last, sketch.pixels)[red][:, 0] > 0).all()


def test_of_a_bare_copy_there_is_a_sketch_and_nothing_else(corner, counted):
    session, source, view = Session(), read(), through_camera(corner, WIDTH, HEIGHT)
    bare = Request(source.copied, (source.state[0], 0), view, request(corner, source, view).settings)
    session.submit(bare)
    assert pictures(session) == [None] and session.sketch.request is bare
    assert not counted["light"] and not counted["picture"]
    submit(session, corner, source, view)
    pictures(session)
    assert session.displayed is not None and session.sketch is None


def test_a_moved_camera_converts_nothing(corner, counted):
    session, source = Session(), read()
    submit(session, corner, source, through_camera(corner, WIDTH, HEIGHT))
    pictures(session)
    corner.camera.location.x += 0.5
    before = session.displayed
    assert submit(session, corner, source, through_camera(corner, WIDTH, HEIGHT))
    after = pictures(session)[-1]
    assert counted["light"] == 1 and not np.array_equal(before.pixels, after.pixels)


def test_asking_for_the_same_is_no_work(corner, counted):
    session, source = Session(), read()
    submit(session, corner, source, through_camera(corner, 64, 48))
    pictures(session)
    assert not submit(session, corner, source, through_camera(corner, 64, 48)) and not session.has_work()


def test_a_resized_region_casts_rays_and_no_more(corner, counted):
    session, source = Session(), read()
    for width in (64, 80):
        submit(session, corner, source, through_camera(corner, width, 48))
        pictures(session)
    assert counted["light"] == 1 and counted["picture"][-1] == (80, 48)


def test_an_edit_that_changes_nothing_is_not_encoded_again(corner):
    session, source, view = Session(), read(), through_camera(corner, 64, 48)
    submit(session, corner, source, view)
    pictures(session)
    lit = session._scene.encoded
    source.changes.add_everything()
    submit(session, corner, read(source), view)
    pictures(session)
    assert session._scene.encoded is lit and session._scene.state == source.state


def test_the_newest_view_is_shown_and_finer_pictures_of_older_ones_are_dropped(corner, monkeypatch):
    session, source = Session(), read()
    first, newest = (through_camera(corner, width, 96) for width in (128, 160))
    submit(session, corner, source, first)
    while session.displayed is None:
        session.step(lambda *_: None)
    assert session.displayed.divisor == 8

    def moves(*_):
        submit(session, corner, source, newest)
    session.step(moves)  # the camera moves while 1/4 is drawn
    assert session.displayed.divisor == 8 and session.displayed.request.view == first
    assert [picture.request.view for picture in pictures(session) if picture] == [newest] * 4


def test_a_first_picture_is_finished_although_the_camera_goes_on(corner, monkeypatch):
    monkeypatch.setattr(sessions, "PATIENCE", 1e9)
    session, source = Session(), read()
    views = [through_camera(corner, width, 96) for width in (128, 136, 144)]
    submit(session, corner, source, views[0])
    session.step(lambda *_: None)
    for view, newer in zip(views, views[1:], strict=False):
        submit(session, corner, source, view)
        session.step(lambda *_, newer=newer: submit(session, corner, source, newer))
        assert session.displayed.request.view == view


def test_what_was_stopped_is_taken_up_again(corner):
    session = Session()
    submit(session, corner, read(), through_camera(corner, 64, 48))

    def stop(*_):
        raise sessions.Stopped()
    session.step(stop)
    assert session.displayed is None and session.has_work() and not session.error
    assert pictures(session)[-1].divisor == 1


def test_an_error_is_said_once_and_tried_again_after_a_change(corner, monkeypatch):
    from bl_ext.user_default.renderformer_v2.model.errors import SceneError

    def fails(*_):
        raise SceneError("The floor is lava: cool it")
    session, source, view = Session(), read(), through_camera(corner, 64, 48)
    with monkeypatch.context() as patch:
        patch.setattr(sessions, "prepare_scene", fails)
        submit(session, corner, source, view)
        session.step(lambda *_: None)
    assert session.error == "The floor is lava: cool it" and not session.has_work()
    source.changes.add_everything()
    submit(session, corner, read(source), view)
    assert pictures(session)[-1].divisor == 1 and not session.error


@pytest.mark.slow
def test_a_view_far_from_the_one_before_is_fitted_anew(corner, counted):
    session, source = Session(), read()
    submit(session, corner, source, through_camera(corner, 128, 96))
    pictures(session)
    corner.camera.location, corner.camera.rotation_euler = (0, 5.6, -1.3), (1.5, 0, 0)
    submit(session, corner, source, through_camera(corner, 128, 96))
    assert any(picture is None for picture in pictures(session))
    assert counted["light"] == 2 and not session.has_work()


def test_an_empty_scene_shows_the_world_and_film_transparency(scene):
    view = through_camera(scene, 32, 24)
    np.testing.assert_allclose(finished(scene, view).pixels, np.broadcast_to((0.25, 0.25, 0.25, 1), (24, 32, 4)),
                               atol=1e-3)
    scene.render.film_transparent = True
    assert not finished(scene, view).pixels.any()


def test_the_triangle_budget_is_the_viewports_own(corner):
    corner.renderformer_v2.max_edge = 0.05
    corner.renderformer_v2.token_budget, corner.renderformer_v2.viewport.token_budget = 4096, 512
    assert 256 < finished(corner, through_camera(corner, 32, 24)).triangles <= 512


def test_a_closed_viewport_holds_nothing(corner):
    session = Session()
    submit(session, corner, read(), through_camera(corner, 64, 48))
    pictures(session)
    session.close()
    assert session._scene is None and session.displayed is None and not session.has_work()


def test_there_are_pictures_while_edits_go_on(corner, monkeypatch):
    monkeypatch.setattr(sessions, "PATIENCE", 1e9)
    session, source, view = Session(), read(), through_camera(corner, 64, 48)
    submit(session, corner, source, view)
    shown = set()
    for _ in range(6):
        edited = []

        def edits(*_, edited=edited):
            if not edited:
                edited.append(True)
                source.changes.add_everything()
                submit(session, corner, read(source), view)
        session.step(edits)
        shown.add(session.displayed and session.displayed.request.state)
    assert len(shown - {None}) == 3 and max(shown - {None}) < source.state
    assert pictures(session)[-1].request.state == source.state


def test_a_long_piece_of_work_is_dropped_once_and_then_finished(corner, monkeypatch):
    monkeypatch.setattr(sessions, "PATIENCE", -1.0)
    session, source, widths = Session(), read(), itertools.cycle((64, 72))
    submit(session, corner, source, through_camera(corner, 56, 48))

    def moves(*_):
        submit(session, corner, source, through_camera(corner, next(widths), 48))
    session.step(moves)
    assert session._scene is None and session.has_work()
    session.step(moves)
    assert session._scene is not None
    session.step(moves)
    assert session.displayed is None and session.has_work()
    session.step(moves)
    assert session.displayed is not None


@pytest.mark.slow
def test_another_view_layer_or_local_view_is_another_scene(corner):
    session, view = Session(), through_camera(corner, 32, 24)
    counts = []
    for hides in (None, lambda obj: obj.name == "Floor", None):
        submit(session, corner, read(hides=hides), view)
        counts.append(pictures(session)[-1].triangles)
    assert counts[0] == counts[2] != counts[1]


def test_keep_scale_and_light_holds_at_once_also_where_the_scene_fits_the_box_before(scene):
    cube(scene)  # fills about as much as one unit of the network
    sun(scene)
    session, source, view = Session(), read(), through_camera(scene, 64, 48)
    scene.renderformer_v2.viewport.resolution, boxes = "8", []
    for scene.renderformer_v2.as_is in (False, True, False):
        submit(session, scene, source, view)
        pictures(session)
        boxes.append(session._scene.framing.box)
        assert (session._scene.scene.exposure is not None) == scene.renderformer_v2.as_is
    np.testing.assert_array_equal(boxes[1], compute.UNIT_BOX)
    np.testing.assert_array_equal(boxes[0], boxes[2])
    assert not has_left(boxes[0], boxes[1]) and not np.array_equal(boxes[0], boxes[1])
