# SPDX-License-Identifier: GPL-3.0-or-later
"""Edges of a picture of few samples are nearer to those of many than Cycles' own are with as few."""
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.first_hits.camera_rays import SAMPLE_POINTS
from bl_ext.user_default.renderformer_v2.rf2_engine import passes

from tests.rf2_engine.f12 import mesh_object, press_f12
from tests.rf2_engine.still_life import tick, with_cycles

MANY = 256
SEEN = ("emission", "environment")


@pytest.fixture
def scene(still_life):
    still_life.render.resolution_x, still_life.render.resolution_y = 96, 72
    still_life.render.film_transparent = True
    still_life.objects["Floor"].hide_render = True
    still_life.renderformer_v2.guide_samples = still_life.cycles.samples = 8
    tick(still_life.view_layers[0], SEEN)
    return still_life


def seen(found):
    """Alpha, and what is seen directly of emitters and world (H, W, 3) each."""
    names = {p.key: p.blender_name for p in passes.PASSES}
    return {"alpha": found["ViewLayer.Combined"][..., 3:]} | {key: found[f"ViewLayer.{names[key]}"] for key in SEEN}


@pytest.mark.parametrize("light", ["TRACED", pytest.param("NETWORK", marks=pytest.mark.slow)])
def test_coverage_is_nearer_to_that_of_many_samples(scene, tmp_path, light):
    scene.renderformer_v2.light = light
    ours, few = seen(press_f12(scene, tmp_path)), seen(with_cycles(scene, tmp_path))
    scene.cycles.samples = MANY
    many = seen(with_cycles(scene, tmp_path))
    for key, truth in many.items():
        mine, theirs = (np.square(found[key] - truth).mean() for found in (ours, few))
        most = 1.02 if key == "emission" else 0.9  # what glows is left as it is, but for a faint rim
        assert theirs > 0 and mine < most * theirs, key


def test_rays_through_a_pixel_cover_an_edge_as_the_pixel_filter_of_cycles_does(lit, tmp_path):
    scene = lit
    scene.render.film_transparent = True
    camera = scene.camera.data
    camera.type, camera.ortho_scale = "ORTHO", 32.0  # one unit wide pixels
    scene.camera.location, scene.camera.rotation_euler = (0, 0, 50), (0, 0, 0)
    scene.render.resolution_x = scene.render.resolution_y = 32
    mesh_object(scene, "Half", [(-99, -99, 9), (0.3, -99, 9), (0.3, 99, 9), (-99, 99, 9)], [(0, 1, 2, 3)])
    scene.cycles.samples, scene.cycles.use_adaptive_sampling = MANY, False
    alpha = with_cycles(scene, tmp_path)["ViewLayer.Combined"][:8, :, 3].mean(0)  # beside the cube
    ours = [(column + SAMPLE_POINTS[:, 0] < 16.3).mean() for column in range(32)]
    np.testing.assert_allclose(ours, alpha, atol=1 / len(SAMPLE_POINTS))
    assert 0.9 < alpha[15] < 0.99  # a filter half as wide would not reach the edge
