# SPDX-License-Identifier: GPL-3.0-or-later
"""Velvet, car paint and a polished floor look in a viewport as in a render, where Cycles says what the camera sees."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.metrics.scores import psnr
from bl_ext.user_default.renderformer_v2.model.pictures import linear_to_srgb

from tests.rf2_engine.f12 import material, press_f12
from tests.rf2_engine.rooms import lamp, rectangle
from tests.rf2_engine.viewport.views import finished, through_camera

WIDTH, HEIGHT = 160, 120
VELVET = {"Base Color": (0.1, 0.01, 0.03, 1), "Roughness": 1.0, "Sheen Weight": 1.0}
PAINT = {"Base Color": (0.5, 0.02, 0.02, 1), "Metallic": 1.0, "Roughness": 0.4, "Coat Weight": 1.0}
POLISHED = {"Roughness": 0.1}


@pytest.mark.parametrize("inputs", [VELVET, PAINT, POLISHED], ids=["velvet", "paint", "polished"])
def test_it_looks_as_in_a_render(scene, tmp_path, inputs):
    made = material("Layered")
    for name, value in inputs.items():
        made.node_tree.nodes["Principled BSDF"].inputs[name].default_value = value
    rectangle(scene, "Floor", (-3, -3, 0), (3, -3, 0), (3, 3, 0), (-3, 3, 0), of=made)
    rectangle(scene, "Wall", (-3, 3, 0), (3, 3, 0), (3, 3, 4), (-3, 3, 4))
    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32, location=(0, 0, 1))
    ball = bpy.context.object
    ball.data.shade_smooth()
    ball.data.materials.append(made)
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.1, 0.1, 0.1, 1)
    scene.camera.location, scene.camera.data.lens = (0, -7, 1.5), 60
    lamp(scene, (-2, -3, 4), (0.6, 0, -0.6))
    scene.renderformer_v2.light, scene.renderformer_v2.guide_samples = "NETWORK", 8
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    bpy.context.view_layer.update()
    shown = finished(scene, through_camera(scene, WIDTH, HEIGHT))
    render = press_f12(scene, tmp_path)["ViewLayer.Combined"]
    encoded = [linear_to_srgb(np.clip(picture[..., :3], 0, 1)) for picture in (shown.pixels, render)]
    bpy.data.objects.remove(ball)
    assert psnr(*encoded) > 37
