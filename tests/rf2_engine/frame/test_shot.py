# SPDX-License-Identifier: GPL-3.0-or-later
"""Key frames: a frame of an animation is fitted by them, whatever else is rendered before it and where."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model import progress
from bl_ext.user_default.renderformer_v2.model.errors import RenderCancelled
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.fitting.framing import Framing
from bl_ext.user_default.renderformer_v2.rf2_engine.frame import shot
from bl_ext.user_default.renderformer_v2.rf2_engine.frame_settings import FrameSettings
from bl_ext.user_default.renderformer_v2.rf2_engine.runtime import model_cache

from tests.rf2_engine.f12 import cube, mesh_object, sun

BOX = np.float32([(-1, -1, 0), (1, 1, 2)])
STEP = shot.BLOCK // 4
IN_FIRST_BLOCK, OTHERS = 1 + 2 * STEP, (1 + 6 * STEP, 1 + 9 * STEP)
SOME = IN_FIRST_BLOCK, *OTHERS


def of_now(scene, fitted=None, width=16):
    """The Shot of the frame that the scene is at; fitted: function that gives the box of a key frame."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    now = shot.Shot.find(depsgraph, FrameSettings.read(depsgraph.scene_eval), width, 16)
    keys, at = now.unknown_keys(), []
    if fitted:
        now.look_ahead(keys, lambda key: at.append(key) or {"scene"},
                       lambda: Framing(np.float32(fitted(at[-1])), None))
    return now


def box_at(scene, frame, boxes):
    """Which box a frame gets that is rendered alone, if frames are by themselves fitted to what `boxes` gives."""
    shot._fitted.clear()
    scene.frame_set(frame)
    return of_now(scene, boxes).settle(Framing(np.float32(boxes(frame)), None)).box


def test_frames_keep_the_box_of_the_first_one(scene):
    for frame in SOME:
        np.testing.assert_array_equal(box_at(scene, frame, lambda frame: BOX * (1 + frame / 200)), BOX * 1.005)


@pytest.mark.parametrize("other", [BOX * 3, BOX / 3, BOX + np.float32((5, 0, 0))])
def test_frames_that_have_left_it_are_fitted_as_the_one_in_which_their_block_begins(scene, other):
    def boxes(frame):
        return BOX if frame == 1 else other * np.float32(1 + frame / 1000)
    for frame in OTHERS:
        key = 1 + (frame - 1) // shot.BLOCK * shot.BLOCK
        np.testing.assert_array_equal(box_at(scene, frame, boxes), boxes(key))


@pytest.mark.parametrize("frame", SOME)
def test_a_frame_far_from_all_key_frames_is_fitted_by_itself(scene, frame):
    np.testing.assert_array_equal(box_at(scene, frame, lambda at: 9 * BOX if at == frame else BOX), 9 * BOX)


def test_a_frame_before_the_animation_is_fitted_by_itself(scene):
    scene.frame_start = 50
    np.testing.assert_array_equal(box_at(scene, 20, lambda frame: BOX * frame), 20 * BOX)


def test_a_range_that_begins_before_the_files_one_does_not_move_the_key_frames(scene, tmp_path):
    """Another machine is given a range that begins within it, and renders the same pictures."""
    scene.frame_start = 20
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "file.blend"))
    for first in (20, 0, 50):  # blender -s
        scene.frame_start = first
        scene.frame_set(60)
        assert of_now(scene).keys == (20, 52)
        scene.frame_set(19)
        assert of_now(scene).keys == ()


def test_key_frames_are_looked_at_once(scene):
    scene.frame_set(OTHERS[0])
    first = of_now(scene, lambda frame: BOX)
    first.settle(Framing(BOX, None))
    first.remember()
    scene.frame_set(OTHERS[0] + 1)
    assert len(first.keys) == 2 and not of_now(scene).unknown_keys()


@pytest.mark.parametrize("change", ["object", "layer", "camera", "size", "file"])
def test_what_is_changed_is_looked_at_anew(scene, change):
    scene.frame_set(IN_FIRST_BLOCK)
    first = of_now(scene, lambda frame: BOX)
    first.settle(Framing(BOX, None))
    first.remember()
    assert not of_now(scene).unknown_keys()
    if change == "object":
        scene.camera.location.x += 1
    elif change == "layer":
        bpy.context.window.view_layer = scene.view_layers.new("Other")
    elif change == "camera":
        scene.camera = bpy.data.objects.new("Other", scene.camera.data)
        scene.collection.objects.link(scene.camera)
    elif change == "file":
        bpy.ops.wm.read_homefile()
        bpy.context.scene.frame_set(IN_FIRST_BLOCK)
    bpy.context.view_layer.update()
    assert of_now(bpy.context.scene, width=17 if change == "size" else 16).unknown_keys() == [1]


@pytest.fixture
def flight(scene):
    """A camera that flies past balls, one of which moves, and leaves what the first frame shows."""
    for x in (0, 2, 20, 22, 24, 26):
        bpy.ops.mesh.primitive_uv_sphere_add(location=(x, 0.3 * x % 2, 0))
    mover = bpy.context.object
    cube(scene), sun(scene)
    mesh_object(scene, "Floor", [(-90, -90, -1), (90, -90, -1), (90, 90, -1), (-90, 90, -1)], [(0, 1, 2, 3)])
    last = OTHERS[-1] + 1
    for frame, x in ((1, 0), (2 * STEP, 1), (3 * STEP, 20), (last, 26)):
        scene.camera.location = (x, -7, 0)
        scene.camera.keyframe_insert("location", frame=frame)
        mover.location.z = x / 20
        mover.keyframe_insert("location", frame=frame)
    scene.frame_start, scene.frame_end, scene.frame_step = 1, last, 1
    scene.renderformer_v2.token_budget = 400
    scene.render.resolution_x = scene.render.resolution_y = 16
    return scene


def given(scene, frame):
    """What tells apart what the network was given of a frame, which is rendered."""
    scene.frame_set(frame)
    bpy.ops.render.render()
    (_, fingerprint, _), = model_cache._encoded
    return fingerprint


def given_in_animation(scene, tmp_path, first, last):
    """The same of every STEP-th frame of an animation."""
    found = {}

    def note(*_):
        (_, found[scene.frame_current], _), = model_cache._encoded
    scene.frame_start, scene.frame_end, scene.frame_step = first, last, STEP
    scene.render.filepath = str(tmp_path / "frame")
    bpy.app.handlers.render_post.append(note)
    try:
        bpy.ops.render.render(animation=True)
    finally:
        bpy.app.handlers.render_post.remove(note)
    return found


def alone(scene, frame):
    shot._fitted.clear()
    return given(scene, frame)


def test_a_frame_is_converted_the_same_alone_and_in_any_order(flight):
    expected = {frame: alone(flight, frame) for frame in SOME}
    assert len(set(expected.values())) == len(SOME)
    shot._fitted.clear()
    a, b, c = SOME
    for frame in (c, b, a, c, a, b, c):  # each after each other
        assert given(flight, frame) == expected[frame]


@pytest.mark.slow
def test_a_frame_is_converted_the_same_in_an_animation_and_in_a_part_of_it(flight, tmp_path):
    frame = OTHERS[0]
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "flight.blend"))
    expected = alone(flight, frame)
    assert given_in_animation(flight, tmp_path, 1, frame)[frame] == expected
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "flight.blend"))
    assert given_in_animation(bpy.context.scene, tmp_path, frame, frame) == {frame: expected}


def test_a_camera_bound_to_a_marker_begins_its_shot_there(flight):
    before = given(flight, IN_FIRST_BLOCK)
    flight.timeline_markers.new("Cut", frame=IN_FIRST_BLOCK).camera = flight.camera
    shot._fitted.clear()
    at_cut, after = given(flight, IN_FIRST_BLOCK), of_now(flight).keys
    flight.frame_set(IN_FIRST_BLOCK + 1)
    assert at_cut != before and after == of_now(flight).keys == (IN_FIRST_BLOCK,)


def test_a_still_is_fitted_to_itself(flight):
    for data in (flight.camera, bpy.data.objects["Sphere.005"]):
        data.animation_data_clear()
    shot._fitted.clear()
    assert len({given(flight, frame) for frame in (1, *SOME)}) == 1


def test_esc_while_a_key_frame_is_looked_at_leaves_nothing_behind(flight):
    def press_esc(*_):
        raise RenderCancelled()
    shot._fitted.clear()
    flight.frame_set(OTHERS[0])
    with progress.reporting(press_esc), pytest.raises(RenderCancelled):
        of_now(flight, lambda frame: BOX)
    assert not shot._fitted
