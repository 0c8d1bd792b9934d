# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings that are changed while a viewport is open: it shows what a viewport that is opened afterwards shows."""
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.viewport.session import Session

from tests.rf2_engine.f12 import cube, material, mesh_object, sun
from tests.rf2_engine.viewport.views import finished, pictures, read, request, through_camera

WIDTH, HEIGHT = 128, 96
CHANGE = {
    "renderformer_v2.max_edge": 0.1, "renderformer_v2.viewport.token_budget": 256,
    "renderformer_v2.viewport.resolution": "2", "renderformer_v2.as_is": True,
    "render.film_transparent": True, "cycles.film_exposure": 3.0,
}
KEEP = {
    "renderformer_v2.light": "TRACED", "renderformer_v2.guide_samples": 3,
    "renderformer_v2.use_adaptive_sampling": True,
    "renderformer_v2.token_budget": 300, "renderformer_v2.lens_samples": 7, "renderformer_v2.shutter_samples": 7,
    "renderformer_v2.paper_lamps": True, "renderformer_v2.reference.use": False,
    "renderformer_v2.viewport.time_limit": 0.5, "render.resolution_percentage": 50, "cycles.samples": 3,
}


@pytest.fixture
def corner(scene):
    """A red cube on a floor in the sun."""
    cube(scene, of=material("Red", (0.8, 0.05, 0.05))).rotation_euler = (0.3, 0.2, 0.5)
    mesh_object(scene, "Floor", [(-4, -3, -1.4), (4, -3, -1.4), (4, 6, -1.4), (-4, 6, -1.4)], [(0, 1, 2, 3)])
    sun(scene)
    ours = scene.renderformer_v2
    ours.light, ours.precision, ours.reference.use, ours.max_edge = "NETWORK", "fp32", True, 0.2
    ours.viewport.resolution, ours.viewport.token_budget, ours.viewport.time_limit = "4", 1024, 0
    return scene


def change(scene, path: str, value) -> None:
    *parts, name = path.split(".")
    for part in parts:
        scene = getattr(scene, part)
    assert getattr(scene, name) != value
    setattr(scene, name, value)


def shown(session, scene, source) -> np.ndarray:
    session.submit(request(scene, read(source), through_camera(scene, WIDTH, HEIGHT)))
    pictures(session)
    return session.displayed.pixels


@pytest.mark.parametrize("path", CHANGE)
def test_what_a_setting_changes_is_shown_at_once(corner, path):
    session, source = Session(), read()
    before = shown(session, corner, source)
    change(corner, path, CHANGE[path])
    after = shown(session, corner, source)
    assert after.shape != before.shape or np.abs(after - before).max() > 1e-4
    np.testing.assert_allclose(after, finished(corner, through_camera(corner, WIDTH, HEIGHT)).pixels, atol=1e-4)


def test_settings_of_renders_alone_change_nothing(corner):
    session, source = Session(), read()
    before = shown(session, corner, source)
    for path, value in KEEP.items():
        change(corner, path, value)
        np.testing.assert_array_equal(shown(session, corner, source), before, err_msg=path)
