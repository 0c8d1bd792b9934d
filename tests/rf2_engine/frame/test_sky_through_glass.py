# SPDX-License-Identifier: GPL-3.0-or-later
"""A room that the sky lights through a pane alone: as bright as in Cycles, whatever the pane's index of refraction."""
import pytest

from tests.rf2_engine.f12 import cube, glass, material, mesh_object
from tests.rf2_engine.rooms import WHITE, assert_alike, beside_cycles


def room_with_a_window(scene, pane):
    """Closed but for an opening of 2 x 1.6 m in its left wall, in which the pane stands."""
    frame = [(y, z) for y in (-2, -1, 1, 2) for z in (0, 0.8, 2.4, 3)]
    around = [[(-2, *frame[4 * i + j]), (-2, *frame[4 * i + j + 4]), (-2, *frame[4 * i + j + 5]),
               (-2, *frame[4 * i + j + 1])] for i in range(3) for j in range(3) if (i, j) != (1, 1)]
    others = [[(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0)], [(-2, -2, 3), (2, -2, 3), (2, 2, 3), (-2, 2, 3)],
              [(-2, 2, 0), (2, 2, 0), (2, 2, 3), (-2, 2, 3)], [(2, -2, 0), (2, 2, 0), (2, 2, 3), (2, -2, 3)],
              [(-2, -2, 0), (2, -2, 0), (2, -2, 3), (-2, -2, 3)]]
    corners = [corner for face in around + others for corner in face]
    mesh_object(scene, "Room", corners, [tuple(range(4 * i, 4 * i + 4)) for i in range(len(corners) // 4)],
                material("White", WHITE))
    if pane == "sheet":
        corners = [(-2, -1, 0.8), (-2, 1, 0.8), (-2, 1, 2.4), (-2, -1, 2.4)]
        mesh_object(scene, "Pane", corners, [(0, 1, 2, 3)], glass(1.45))
    else:
        cube(scene, "Pane", (-2, 0, 1.6), glass(pane)).scale = (0.01, 1, 0.8)
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 8
    scene.camera.location, scene.camera.rotation_euler = (1.6, -1.8, 1.7), (1.38, 0, 0.67)
    scene.camera.data.lens = 18


@pytest.mark.parametrize("pane", [1.0, 1.2, 1.45, 2.0, "sheet"])
def test_a_pane_lets_as_much_of_the_sky_pass_as_in_cycles(scene, tmp_path, pane):
    room_with_a_window(scene, pane)
    ours, cycles = beside_cycles(scene, tmp_path)
    assert ours.mean() / cycles.mean() == pytest.approx(1, abs=0.1)
    assert_alike(ours, cycles, rtol=0.3, atol=0.02)
