# SPDX-License-Identifier: GPL-3.0-or-later
"""Walls that the camera does not see keep light out of what it sees behind them."""
import numpy as np
import pytest

from tests.rf2_engine.f12 import cube, press_f12
from tests.rf2_engine.rooms import lamp, room

HALF = 0.4  # of a side of the box


@pytest.mark.parametrize("light", ["TRACED", "NETWORK"])
def test_the_floor_inside_of_a_box_that_the_camera_does_not_see_is_dark(scene, tmp_path, light):
    """In Cycles it has less than 0.001, and the floor around it 0.6 to 1.8."""
    room(scene)
    lamp(scene)
    box = cube(scene, "Box", (0.5, 0, HALF))
    box.scale, box.visible_camera = (HALF,) * 3, False
    scene.camera.location, scene.camera.rotation_euler = (0, -2.5, 2.6), (0.77, 0, -0.2)
    scene.render.resolution_x, scene.render.resolution_y = 80, 56
    scene.renderformer_v2.light, scene.renderformer_v2.max_edge = light, 0.1
    passes = press_f12(scene, tmp_path)
    place = passes["ViewLayer.Position"] - box.location
    is_inside = (np.abs(place[..., :2]) < 0.6 * HALF).all(-1) & (np.abs(place[..., 2] + HALF) < 0.01)
    assert is_inside.sum() > 30
    assert passes["ViewLayer.Combined"][is_inside, :3].mean() < 0.006
