# SPDX-License-Identifier: GPL-3.0-or-later
"""Beams that are narrow beside the lamps that send them light what they light in Cycles."""
import math

import pytest

from tests.rf2_engine.rooms import assert_alike, beside_cycles, lamp, rectangle


@pytest.mark.parametrize("kind, settings", [
    ("AREA", {"size": 0.6, "spread": math.radians(1)}), ("AREA", {"size": 0.6, "spread": math.radians(5)}),
    ("SPOT", {"shadow_soft_size": 0.5, "spot_size": math.radians(40)})])
def test_lamps_light_as_much_as_in_cycles(scene, tmp_path, kind, settings):
    rectangle(scene, "Floor", (-3, -3, 0), (3, -3, 0), (3, 3, 0), (-3, 3, 0))
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.05, 0.05, 0.05, 1)
    scene.camera.location, scene.camera.rotation_euler = (0, -3.5, 3.5), (math.pi / 4, 0, 0)
    light = lamp(scene, (0, 0, 2.5), (0, 0, 0), {"AREA": 10, "SPOT": 100}[kind], kind)
    for name, value in settings.items():
        setattr(light.data, name, value)
    scene.renderformer_v2.light = "NETWORK"
    assert_alike(*beside_cycles(scene, tmp_path), rtol=0.18, atol=0.02)
