# SPDX-License-Identifier: GPL-3.0-or-later
"""A camera under water sees the ground mirrored in the surface, as bright as in Cycles."""
import pytest

from tests.rf2_engine.f12 import material
from tests.rf2_engine.rooms import assert_alike, beside_cycles, rectangle


def square(scene, name, side, height, of):
    rectangle(scene, name, *((x, y, height) for x, y in ((-side, -side), (side, -side), (side, side), (-side, side))),
              of=of)


@pytest.mark.parametrize("light, rtol", [("TRACED", 0.2), ("NETWORK", 0.4)])
def test_all_light_is_reflected_beyond_the_critical_angle(scene, tmp_path, light, rtol):
    water = material("Water", (1, 1, 1))
    inputs = water.node_tree.nodes["Principled BSDF"].inputs
    inputs["Roughness"].default_value, inputs["IOR"].default_value = 0, 1.33
    inputs["Transmission Weight"].default_value = 1
    square(scene, "Ground", 10, -2, material("Sand", (0.7, 0.6, 0.4)))
    square(scene, "Surface", 12, 0, water)
    scene.camera.location, scene.camera.rotation_euler = (0, -3.5, -1.2), (1.9, 0, 0)
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.6, 0.8, 1, 1)
    scene.renderformer_v2.light = light
    ours, cycles = beside_cycles(scene, tmp_path)
    assert_alike(ours, cycles, rtol, atol=0)
