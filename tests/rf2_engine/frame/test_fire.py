# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes that shine light a room as in Cycles, also after a bounce."""
import pytest

from tests.rf2_engine.f12 import cube, glass, material, volume_material
from tests.rf2_engine.rooms import assert_alike, beside_cycles, panel, rectangle, remarks, room

VOLUMES = {
    "glowing smoke": ("VolumePrincipled", {"Density": 0.3, "Emission Strength": 8, "Emission Color": (1, 0.4, 0.1, 1)}),
    "a black body": ("VolumePrincipled", {"Density": 1, "Blackbody Intensity": 1, "Temperature": 1500}),
    "light alone": ("Emission", {"Strength": 4, "Color": (0.2, 0.6, 1, 1)}),
}


@pytest.mark.parametrize("volume, light", [
    ("glowing smoke", "TRACED"), ("a black body", "NETWORK"), *(
        pytest.param(*others, marks=pytest.mark.slow) for others in (
            ("glowing smoke", "NETWORK"), ("a black body", "TRACED"),
            ("light alone", "TRACED"), ("light alone", "NETWORK")))])
def test_fire_lights_a_room(scene, tmp_path, volume, light):
    room(scene)
    cube(scene, "Fire", (-1, 0, 0.8), volume_material("Fire", *VOLUMES[volume])).scale = (0.5,) * 3
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0
    scene.renderformer_v2.light = light
    ours, cycles = beside_cycles(scene, tmp_path)
    assert_alike(ours, cycles, *((0.12, 0.004) if light == "TRACED" else (0.25, 0.02)))
    assert "emission" not in remarks() and "empty" not in remarks()


def test_mirrors_and_glass_show_fire(scene, tmp_path):
    room(scene)
    cube(scene, "Fire", (-1, 0, 0.8), volume_material("Fire", *VOLUMES["glowing smoke"])).scale = (0.5,) * 3
    rectangle(scene, "Pane", (-2, -1, 0.1), (0, -1, 0.1), (0, -1, 1.6), (-2, -1, 1.6), of=glass(1.0))
    mirror = material("Mirror")
    inputs = mirror.node_tree.nodes["Principled BSDF"].inputs
    inputs["Metallic"].default_value, inputs["Roughness"].default_value = 1, 0
    panel(scene, mirror)
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0
    scene.renderformer_v2.light = "NETWORK"
    assert_alike(*beside_cycles(scene, tmp_path), 0.25, 0.02)
