# SPDX-License-Identifier: GPL-3.0-or-later
"""More lights than there is room for: how bright the ground is stays what it is in Cycles."""
from dataclasses import replace

import numpy as np
import pytest

from mathutils import Euler, Matrix

from tests.rf2_engine.convert.cycles_reference import empty_cycles_scene, lamp, material, seen_flat_on
from tests.rf2_engine.convert.token_light import integrated

GROUND = 4.0  # metres


def mean_irradiance(converted, report, side=GROUND, places=9):
    """(3,) of the middle of the ground, by Cycles and by the tokens; places: that are looked at along either side."""
    white, _, _ = material("ShaderNodeBsdfDiffuse", "White", Color=(1, 1, 1, 1))
    measured = np.pi * seen_flat_on(white, 2 * side, resolution=32).mean(axis=(0, 1))
    scene, at = converted(), (np.arange(places) + 0.5) / places * side - side / 2
    report.converted = scene
    found = np.mean([integrated(scene, (x, y, 0), (0, 0, 1), cuts=1) for x in at for y in at], axis=0)
    return measured, found


@pytest.mark.parametrize("budget", [pytest.param(1_000_000, marks=pytest.mark.slow), 2048])
def test_two_hundred_lamps_give_as_much_light(add_mesh, converted, report, budget):
    empty_cycles_scene(samples=64)
    random = np.random.default_rng(1)
    for i in range(200):
        kind = ("POINT", "AREA", "SPOT")[i % 3]
        place = Matrix.Translation((*random.uniform(-2, 2, 2), random.uniform(1, 2)))
        lamp(kind, place @ Euler(random.uniform(-0.4, 0.4, 3)).to_matrix().to_4x4(), energy=random.uniform(1, 9),
             color=random.uniform(0.2, 1, 3), **(dict(size=0.2) if kind == "AREA" else dict(shadow_soft_size=0.05)))
    add_mesh("Corner", ((2, 2, -0.05), (-2, -2, -0.05), (2, -2, -0.05)))
    measured, found = mean_irradiance(lambda: converted(token_budget=budget), report)
    np.testing.assert_allclose(found, measured, rtol=0.02)
    assert len(report.converted) <= budget
    assert any(name == "Lamps" and "replace 200" in message for _, name, message in report.entries) == (budget < 1e6)


@pytest.mark.parametrize("kind, coarser", [("POINT", True), ("AREA", False)])
def test_lamps_are_called_coarser_where_they_have_fewer_triangles(add_mesh, converted, report, kind, coarser):
    """Small area lamps have two at any rate."""
    empty_cycles_scene()
    for i in range(60):
        lamp(kind, Matrix.Translation((i % 8, i // 8, 3)), energy=9, **(dict(size=0.1) if kind == "AREA" else {}))
    add_mesh("Ground", ((20, 20, 0), (-20, 20, 0), (0, -20, 0)))
    converted(token_budget=300)
    assert any("lights replace 60" in message for _, _, message in report.entries)
    assert any("coarser" in message for _, _, message in report.entries) == coarser


@pytest.mark.parametrize("budget", [1_000_000, 1024, 300])
def test_forty_lamps_of_all_kinds_give_as_much_light(add_mesh, converted, report, budget):
    empty_cycles_scene(samples=64)
    random = np.random.default_rng(3)
    for i in range(40):
        kind = ("POINT", "AREA", "SPOT", "SUN")[i % 4]
        own = {"POINT": dict(shadow_soft_size=0.1), "SPOT": dict(shadow_soft_size=0.05, spot_size=1.5, spot_blend=0.5),
               "AREA": dict(size=0.3, spread=2.5), "SUN": dict(angle=0.1)}[kind]
        place = Matrix.Translation((*random.uniform(-2, 2, 2), random.uniform(1, 2)))
        lamp(kind, place @ Euler(random.uniform(-0.5, 0.5, 3)).to_matrix().to_4x4(), color=random.uniform(0.2, 1, 3),
             energy=random.uniform(0.02, 0.1) if kind == "SUN" else random.uniform(1, 9), **own)
    add_mesh("Corner", ((2, 2, -0.05), (-2, -2, -0.05), (2, -2, -0.05)))
    # As wide as nearly all of the light goes: those that are merged send it elsewhere.
    measured, found = mean_irradiance(lambda: converted(token_budget=budget), report, side=14, places=25)
    np.testing.assert_allclose(found, measured, rtol=0.02)
    assert len(report.converted) <= budget


@pytest.mark.parametrize("budget", [pytest.param(1_000_000, marks=pytest.mark.slow), 600])
def test_a_thousand_small_shining_triangles_give_as_much_light(add_mesh, converted, report, budget):
    empty_cycles_scene(samples=64)
    random = np.random.default_rng(2)
    middle = np.concatenate([random.uniform(-2, 2, (1000, 1, 2)), random.uniform(1, 2, (1000, 1, 1))], axis=2)
    corners = middle + random.normal(0, 0.006, (1000, 3, 3))
    glow = material("ShaderNodeEmission", "Glow", Color=(1, 0.5, 0.2, 1), Strength=2000.0)[0]
    add_mesh("Confetti", corners.reshape(-1, 3), np.arange(3000).reshape(-1, 3).tolist(), [glow])
    measured, found = mean_irradiance(lambda: both_sides(converted(token_budget=budget)), report)
    assert len(report.converted) <= 2 * budget
    np.testing.assert_allclose(found, measured, rtol=0.02)


def both_sides(scene):
    """Surfaces shine on both sides, and `integrated` looks at the front."""
    return scene.appended(replace(scene, triangles=scene.triangles[:, ::-1]))
