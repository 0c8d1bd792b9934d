# SPDX-License-Identifier: GPL-3.0-or-later
"""What half-transparent surfaces show of themselves and of what lies behind is as in Cycles, and not grainy."""
import numpy as np
import pytest

from tests.rf2_engine.f12 import material
from tests.rf2_engine.rooms import assert_alike, beside_cycles, lamp, panel, rectangle, room


def grain(picture: np.ndarray) -> float:
    """How far pixels are off the mean of their neighbours, at the middle one of all pixels."""
    around = (picture[:-2, 1:-1] + picture[2:, 1:-1] + picture[1:-1, :-2] + picture[1:-1, 2:]) / 4
    return float(np.median(np.abs(picture[1:-1, 1:-1] - around)))


@pytest.mark.parametrize("light, rtol", [("TRACED", 0.13), ("NETWORK", 0.2)])
def test_a_curtain_and_the_room_behind_it_are_as_in_cycles(scene, tmp_path, light, rtol):
    room(scene, back=material("Back", (0.8, 0.2, 0.1)))
    lamp(scene)
    curtain = material("Curtain", (0.2, 0.7, 0.9))
    curtain.node_tree.nodes["Principled BSDF"].inputs["Alpha"].default_value = 0.5
    rectangle(scene, "Curtain", (-1.6, -1, 0.4), (1.6, -1, 0.4), (1.6, -1, 2.6), (-1.6, -1, 2.6), of=curtain)
    panel(scene, material("Panel", (0.9, 0.9, 0.2)))
    scene.renderformer_v2.light = light
    ours, cycles = beside_cycles(scene, tmp_path)
    assert_alike(ours, cycles, rtol=rtol, blocks=8)
    assert grain(ours) < 1.5 * grain(cycles) + 1e-3


def test_what_two_smoked_panes_show_is_not_grainy(scene, tmp_path):
    """They send on so little light that all paths pass the second one."""
    room(scene, back=material("Back", (0.8, 0.2, 0.1)))
    lamp(scene)
    smoked = material("Smoked", (0.03, 0.03, 0.03))
    smoked.node_tree.nodes["Principled BSDF"].inputs["Alpha"].default_value = 0.7
    for y in (-1, -0.9):
        rectangle(scene, "Pane", (-2.4, y, 0.1), (2.4, y, 0.1), (2.4, y, 2.9), (-2.4, y, 2.9), of=smoked)
    scene.renderformer_v2.light = "NETWORK"
    ours, cycles = beside_cycles(scene, tmp_path)
    assert ours.mean() == pytest.approx(cycles.mean(), rel=0.1)
    assert grain(ours) < 1.5 * grain(cycles) + 1e-3
