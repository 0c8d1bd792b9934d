# SPDX-License-Identifier: GPL-3.0-or-later
"""Small objects in a viewport with the default settings, which simplify them, look as in a render."""
import math

import bpy
import numpy as np

from bl_ext.user_default.renderformer_v2.model.metrics.scores import psnr
from bl_ext.user_default.renderformer_v2.model.pictures import linear_to_srgb

from tests.rf2_engine.f12 import material, mesh_object, press_f12
from tests.rf2_engine.viewport.views import finished, through_camera

WIDTH, HEIGHT = 240, 144


def room(scene):
    white = material("White", (0.75, 0.75, 0.75))
    corners = [(x, y, z) for x in (-2, 2) for y in (-3, 2) for z in (-1, 1.5)]
    mesh_object(scene, "Room", corners, [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4),
                                         (1, 5, 7, 3)], white)
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "AREA"))
    lamp.location, lamp.data.energy, lamp.data.size = (0, -0.5, 1.45), 60, 0.8
    scene.collection.objects.link(lamp)


def text(words, location, size, color):
    bpy.ops.object.text_add(location=location, rotation=(math.pi / 2, 0, 0))
    obj = bpy.context.object
    obj.data.body, obj.data.size, obj.data.extrude = words, size, 0.03
    obj.data.materials.append(material(words, color))


def test_text_is_whole_in_a_viewport_with_the_default_settings(scene, tmp_path):
    room(scene)
    text("Hello", (-1.1, 1.9, 0), 0.9, (0.05, 0.1, 0.6))
    for i in range(6):  # which take the triangles
        bpy.ops.mesh.primitive_uv_sphere_add(radius=0.2, location=(0.5 * i - 1.25, 0.5, -0.8))
        bpy.ops.object.shade_smooth()
        bpy.context.object.data.materials.append(material(f"Ball {i}", (0.1 + 0.15 * i, 0.5, 0.9 - 0.15 * i)))
    scene.camera.location = 0, -2.9, 0.2
    scene.camera.data.lens = 30
    scene.renderformer_v2.light, scene.renderformer_v2.guide_samples = "NETWORK", 8
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    bpy.context.view_layer.update()
    shown = finished(scene, through_camera(scene, WIDTH, HEIGHT))
    assert shown.triangles <= scene.renderformer_v2.viewport.token_budget
    assert shown.triangles < sum(len(obj.data.polygons) for obj in scene.objects if obj.type == "MESH")
    render = press_f12(scene, tmp_path)["ViewLayer.Combined"]
    encoded = [linear_to_srgb(np.clip(picture[..., :3], 0, 1)) for picture in (shown.pixels, render)]
    assert psnr(*encoded) > 35
