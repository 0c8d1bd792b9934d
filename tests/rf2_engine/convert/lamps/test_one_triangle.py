# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps as one triangle each, as training scenes of the published weights have them."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.normalize import Normalization, central_irradiance
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.copied import ConversionOptions
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.report import Report
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.scene import convert

from tests.rf2_engine import f12


def converted(paper_lamps: bool):
    return convert(bpy.context.evaluated_depsgraph_get(), None,
                   ConversionOptions(10_000, 1e6, paper_lamps=paper_lamps), Report())


@pytest.mark.parametrize("kind, location", [("SUN", (0, 0, 9)), ("POINT", (3, 2, 4)), ("AREA", (0, -9, 5)),
                                            ("SPOT", (4, 0, 4))])
def test_a_lamp_outside_becomes_a_triangle_of_the_training_with_the_same_light(scene, kind, location):
    f12.cube(scene)
    light = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", kind))
    light.data.energy, light.location = 50, location
    light.rotation_euler = (0.7, 0.1, 0.2)
    scene.collection.objects.link(light)
    before, after = converted(False), converted(True)
    assert after.is_light.sum() == 1 and not after.is_seen[after.is_light].any()
    frame = Normalization.of(before)
    corners = (after.triangles[after.is_light][0] - frame.center) * frame.scale
    assert 2.09 < np.linalg.norm(corners.mean(axis=0)) < 2.71
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0]) / 2
    assert 0.0087 < np.linalg.norm(normal) < 0.0135 and normal @ corners.mean(axis=0) < 0
    given, found = (central_irradiance(it, frame.center, frame.scale).sum() for it in (before, after))
    np.testing.assert_allclose(found, given, rtol=1e-3)
    assert len(after) - 1 == (~before.is_light & before.is_seen).sum()  # nothing that holds its light together is left


def test_a_lamp_inside_the_scene_stays_where_it_is(scene):
    for x in (-3, 3):
        f12.cube(scene, f"Cube {x}", (x, 0, 0))
    light = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    light.data.energy, light.location = 50, (0.5, 0.5, 0.2)
    scene.collection.objects.link(light)
    after = converted(True)
    np.testing.assert_allclose(after.triangles[after.is_light].mean(axis=(0, 1)), (0.5, 0.5, 0.2), atol=1e-4)
