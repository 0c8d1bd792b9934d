# SPDX-License-Identifier: GPL-3.0-or-later
"""Walls that the camera does not see keep light out of what it sees behind them."""
import bpy
import numpy as np

from tests.rf2_engine.f12 import cube, press_f12
from tests.rf2_engine.rooms import lamp, room

HALF = 0.4  # of a side of the box


def test_the_floor_inside_of_a_box_that_the_camera_does_not_see_is_dark(scene, tmp_path):
    """In Cycles it has less than 0.001, and the floor around it 0.6 to 1.8."""
    room(scene)
    lamp(scene)
    box = cube(scene, "Box", (0.5, 0, HALF))
    box.scale, box.visible_camera = (HALF,) * 3, False
    scene.camera.location, scene.camera.rotation_euler = (0, -7, 2.5), (1.4, 0, 0)
    scene.render.resolution_x, scene.render.resolution_y = 160, 112
    scene.renderformer_v2.max_edge = 0.1
    scene.view_layers[0].use_pass_diffuse_indirect = True
    passes = press_f12(scene, tmp_path)
    place = passes["ViewLayer.Position"] - box.location
    is_inside = (np.abs(place[..., :2]) < (0.8 * HALF, 0.4 * HALF)).all(-1) & (np.abs(place[..., 2] + HALF) < 0.01)
    assert is_inside.sum() > 10
    name = "ViewLayer.DiffInd" if bpy.app.version < (5,) else "ViewLayer.Diffuse Indirect"
    assert np.median(passes[name][is_inside]) < 0.003
