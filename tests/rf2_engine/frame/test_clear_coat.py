# SPDX-License-Identifier: GPL-3.0-or-later
"""Clear coats mirror lamps and their surroundings sharply above what is rough, as in Cycles."""
import bpy
import numpy as np
import pytest

from tests.rf2_engine.f12 import material
from tests.rf2_engine.rooms import beside_cycles, lamp, rectangle


def coated(**inputs):
    made = material("Paint", (0.5, 0.02, 0.02))
    shader = made.node_tree.nodes["Principled BSDF"]
    for name, value in {"Coat Weight": 1.0, "Coat Roughness": 0.03, **inputs}.items():
        shader.inputs[name].default_value = value
    return made


PAINT, LACQUER = {"Metallic": 1.0, "Roughness": 0.4}, {"Roughness": 0.6}
HALF = {"Roughness": 0.7, "Coat Weight": 0.5, "Coat Roughness": 0.1}


@pytest.mark.parametrize("light", ["TRACED", "NETWORK"])
@pytest.mark.parametrize("inputs", [PAINT, LACQUER, HALF], ids=["paint", "lacquer", "half"])
def test_a_lamp_and_a_floor_are_seen_in_a_coat_as_in_cycles(scene, tmp_path, light, inputs):
    rectangle(scene, "Floor", (-3, -3, 0), (3, -3, 0), (3, 3, 0), (-3, 3, 0))
    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32, location=(0, 0, 1))
    ball = bpy.context.object
    ball.data.shade_smooth()
    ball.data.materials.append(coated(**inputs))
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.1, 0.1, 0.1, 1)
    scene.camera.location, scene.camera.data.lens = (0, -7, 1.5), 120
    lamp(scene, (-2, -3, 4), (0.6, 0, -0.6), energy=150).data.size = 1.2
    scene.renderformer_v2.light = light
    ours, cycles = beside_cycles(scene, tmp_path)
    bpy.data.objects.remove(ball)
    green = cycles[..., 1]  # of which the paint itself has next to none
    brightest = green >= np.sort(green.ravel())[-16]
    assert brightest.sum() < 20 and green[brightest].mean() > 1.5 * green.mean()
    assert ours[brightest].mean() == pytest.approx(cycles[brightest].mean(), rel=0.12)
    assert ours.mean() == pytest.approx(cycles.mean(), rel=0.03)
