# SPDX-License-Identifier: GPL-3.0-or-later
"""Glass of few facets with smooth shading: normals and facets disagree, and Cycles loses light between both."""
import math

import numpy as np
import pytest

from tests.rf2_engine.f12 import glass, material, mesh_object
from tests.rf2_engine.rooms import WHITE, beside_cycles

SIDES = 12


def tumbler(scene):
    """A glass of 12 sides and flat rims, 1 m high, whose normals turn by 90 degrees from its sides to these."""
    profile = [(0, 0), (0.4, 0), (0.45, 1), (0.4, 1), (0.35, 0.1), (0, 0.1)]
    turns = [2 * math.pi * i / SIDES for i in range(SIDES)]
    corners = [(r * math.cos(turn), r * math.sin(turn), z) for turn in turns for r, z in profile[1:-1]]
    top, bottom, rings = len(corners), len(corners) + 1, len(profile) - 2
    faces = [(rings * i + k, rings * ((i + 1) % SIDES) + k, rings * ((i + 1) % SIDES) + k + 1, rings * i + k + 1)
             for i in range(SIDES) for k in range(rings - 1)]
    faces += [(bottom, rings * ((i + 1) % SIDES), rings * i) for i in range(SIDES)]
    faces += [(top, rings * i + rings - 1, rings * ((i + 1) % SIDES) + rings - 1) for i in range(SIDES)]
    made = mesh_object(scene, "Tumbler", [*corners, (0, 0, 0.1), (0, 0, 0)], faces, glass(1.5))
    made.data.shade_smooth()
    made.location.z = 0.02


def test_coarse_smooth_glass_has_the_dark_parts_of_cycles(scene, tmp_path):
    tumbler(scene)
    mesh_object(scene, "Floor", [(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], [(0, 1, 2, 3)],
                material("White", WHITE))
    scene.camera.location, scene.camera.rotation_euler = (0, -2.6, 1.4), (math.radians(70), 0, 0)
    scene.camera.data.lens = 50
    ours, cycles = beside_cycles(scene, tmp_path)
    is_dark = cycles.mean(-1) < 0.5 * np.median(cycles)
    assert is_dark.sum() > 200
    assert ours[is_dark].mean() == pytest.approx(cycles[is_dark].mean(), rel=0.2)
