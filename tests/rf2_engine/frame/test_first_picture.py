# SPDX-License-Identifier: GPL-3.0-or-later
"""In a window a render shows surfaces without light while the scene is converted, and ends like any other."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.errors import RenderCancelled, SceneError
from bl_ext.user_default.renderformer_v2.rf2_engine import passes
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.copying import cache as copies
from bl_ext.user_default.renderformer_v2.rf2_engine.frame import first_hits, first_picture
from bl_ext.user_default.renderformer_v2.rf2_engine.frame.layer import Layer

from tests.rf2_engine.f12 import cube, material, press_f12, sun


@pytest.fixture
def still(scene):
    cube(scene, of=material("Red", (0.8, 0.05, 0.05))).rotation_euler = (0.3, 0.2, 0.5)
    sun(scene)
    scene.render.film_transparent = True
    return scene


@pytest.fixture
def watched(monkeypatch):
    """As if there were a window; the Combined passes that are written, and the meshes that are read."""
    written, reads = [], []

    def write(engine, layer, some, view="", real=passes.write):
        written.append(some.get("combined"))
        real(engine, layer, some, view)

    def read_mesh(mesh, name, *rest, real=copies.read_mesh):
        reads.append(name)
        return real(mesh, name, *rest)
    monkeypatch.setattr(first_picture, "is_watched", lambda engine: True)
    monkeypatch.setattr(passes, "write", write)
    monkeypatch.setattr(copies, "read_mesh", read_mesh)
    return written, reads


def test_surfaces_come_first_and_the_picture_is_the_same(still, watched, tmp_path, monkeypatch):
    written, reads = watched
    shown = press_f12(still, tmp_path)["ViewLayer.Combined"]
    first = written[0]
    assert first.shape == shown.shape and reads == ["Cube"]
    np.testing.assert_array_equal(first[2:-2, 2:-2, 3] > 0.5, shown[2:-2, 2:-2, 3] > 0.5)
    red = first[first[..., 3] > 0]
    assert len(red) and (red[:, 0] > 10 * red[:, 1]).all()
    monkeypatch.setattr(first_picture, "is_watched", lambda engine: False)
    np.testing.assert_allclose(press_f12(still, tmp_path)["ViewLayer.Combined"], shown, atol=1e-3)


def test_large_pictures_are_drawn_in_squares(still, watched, tmp_path, monkeypatch):
    monkeypatch.setattr(first_picture, "PIXELS", 300)
    shown = press_f12(still, tmp_path)["ViewLayer.Combined"]
    assert watched[0][0].shape == shown.shape
    assert abs(watched[0][0][..., 3].mean() - shown[..., 3].mean()) < 0.1


@pytest.mark.parametrize("end, stays", [(RenderCancelled, True), (SceneError, False)])
@pytest.mark.parametrize("step", [(Layer, "convert"), (first_hits.cycles_session, "render_views")])
def test_what_was_shown_first_stays_after_esc(still, watched, tmp_path, monkeypatch, step, end, stays):
    def ended(*_, **__):
        raise end("ended")
    monkeypatch.setattr(*step, ended)
    left = press_f12(still, tmp_path, may_fail=True)["ViewLayer.Combined"]
    shown = watched[0][0]
    assert shown.any() and np.array_equal(left, shown) == stays


def test_nobody_waits_in_the_background_or_for_an_animation(still, tmp_path):
    assert bpy.app.background and not first_picture.is_watched(None)
