# SPDX-License-Identifier: GPL-3.0-or-later
"""A room that the sky lights through a small opening, which few of Cycles' samples find."""
import numpy as np

from tests.rf2_engine.f12 import cube, press_f12
from tests.rf2_engine.rooms import DEPTH, HEIGHT, WIDTH, rectangle, room

HALF = 0.4  # of a side of the opening


def test_what_hangs_below_a_skylight_throws_a_shadow_with_8_samples(scene, tmp_path):
    """Below it Cycles with 1,024 samples has 0.41 of the light beside it, and its denoiser made 0.98 of 8."""
    room(scene)
    x, y, z, h = WIDTH, DEPTH, HEIGHT, HALF
    scene.objects["ceiling"].hide_render = True
    for i, (left, right, near, far) in enumerate(((-x, -h, -y, y), (h, x, -y, y), (-h, h, -y, -h), (-h, h, h, y))):
        rectangle(scene, f"ceiling {i}", (left, near, z), (left, far, z), (right, far, z), (right, near, z))
    rectangle(scene, "front", (-x, -y, 0), (-x, -y, z), (x, -y, z), (x, -y, 0))
    sky = scene.world.node_tree.nodes["Background"].inputs
    sky["Color"].default_value, sky["Strength"].default_value = (1, 1, 1, 1), 60
    cube(scene, "Panel", (0, 0, 0.8)).scale = 0.5, 0.5, 0.02
    scene.camera.location, scene.camera.data.lens = (0, -2.9, 1.5), 18
    scene.render.resolution_x, scene.render.resolution_y = 96, 64
    scene.renderformer_v2.guide_samples = 8
    passes = press_f12(scene, tmp_path)
    light, place = passes["ViewLayer.Combined"][..., :3].mean(-1), passes["ViewLayer.Position"]
    is_floor = (np.abs(place[..., 2]) < 0.01) & place.any(-1)
    below = light[is_floor & (np.abs(place[..., :2]) < 0.3).all(-1)]
    beside = light[is_floor & (np.abs(np.abs(place[..., 0]) - 1) < 0.2) & (np.abs(place[..., 1]) < 0.3)]
    assert min(len(below), len(beside)) > 40 and below.mean() < 0.65 * beside.mean()
