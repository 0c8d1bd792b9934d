# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps of negative strength take direct and bounced light away, as in Cycles."""
import pytest

from tests.rf2_engine.rooms import assert_alike, beside_cycles, lamp, rectangle, remarks, room


@pytest.mark.parametrize("light", ["TRACED", "NETWORK"])
@pytest.mark.parametrize("kind, energy", [("POINT", -40), pytest.param("AREA", -20, marks=pytest.mark.slow)])
def test_a_negative_lamp_takes_as_much_light_as_in_cycles(scene, tmp_path, light, kind, energy):
    room(scene)
    lamp(scene)
    lamp(scene, (1.2, 0.5, 1.5), (0, 0, 0), energy, kind).name = "Dark"
    scene.renderformer_v2.light = light
    assert_alike(*beside_cycles(scene, tmp_path), rtol=0.12)
    assert "negative" not in remarks()


def test_what_it_takes_is_no_shadow_to_the_network(scene, tmp_path):
    """Which compares traced light with an estimate, and finds most of it missing."""
    size = 3.0
    rectangle(scene, "Floor", (-size, -size, 0), (size, -size, 0), (size, size, 0), (-size, size, 0))
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.4, 0.4, 0.4, 1)
    scene.camera.location, scene.camera.data.lens = (0, -7, 1.5), 35
    lamp(scene, (1.5, -2, 3), (0.6, 0.4, 0))
    lamp(scene, (0, -1, 0.8), energy=-30, kind="POINT")
    assert_alike(*beside_cycles(scene, tmp_path), blocks=8)
