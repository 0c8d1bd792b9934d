# SPDX-License-Identifier: GPL-3.0-or-later
"""Polished surfaces show sharply what stands before large lights."""
from tests.rf2_engine.f12 import cube, material
from tests.rf2_engine.rooms import beside_cycles, rectangle


def test_a_polished_floor_mirrors_a_dark_box_before_a_bright_wall(scene, tmp_path):
    """It has one place of the wall in each pixel, and not as much of all of it as shadow rays find."""
    acrylic, bright, dark = material("Acrylic", (0.01,) * 3), material("Bright"), material("Dark", (0.02,) * 3)
    acrylic.node_tree.nodes["Principled BSDF"].inputs["Roughness"].default_value = 0.02
    inputs = bright.node_tree.nodes["Principled BSDF"].inputs
    inputs["Emission Color"].default_value, inputs["Emission Strength"].default_value = (1, 1, 1, 1), 2
    rectangle(scene, "floor", (-9, -9, 0), (9, -9, 0), (9, 3, 0), (-9, 3, 0), of=acrylic)
    rectangle(scene, "wall", (-6, 3, 0), (6, 3, 0), (6, 3, 5), (-6, 3, 5), of=bright)
    cube(scene, location=(0, 0, 1.01), of=dark)
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0
    scene.camera.location, scene.camera.rotation_euler = (0, -8, 2), (1.4, 0, 0)
    scene.camera.data.lens = 35
    scene.renderformer_v2.light = "NETWORK"
    ours, cycles = (picture[24:, :, 1] for picture in beside_cycles(scene, tmp_path))
    assert cycles[:, 24].mean() < cycles[:, 4].mean() / 4
    assert abs(ours - cycles).mean() < 0.1 * cycles.mean()
