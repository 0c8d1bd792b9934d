# SPDX-License-Identifier: GPL-3.0-or-later
"""How much light a lamp gives: energy, colour, exposure, temperature, nodes and "Normalize" (measured in Cycles)."""
from __future__ import annotations

import math

import numpy as np

from .shading import graph
from .shading.evaluate import Evaluator, Points
from .shading.image import ImageCache
from .shading.node_call import NodeCall
from .shading.surface import closure_at


def lamp_strength(light, name: str, report, distance: float = 1.0) -> np.ndarray | None:
    """(3,) energy times colour, exposure, temperature and node tree; None when the lamp gives no light.

    distance: from the lamp to the middle of what is looked at, for lamps that do not fall off with its square.
    """
    if light.type == "AREA" and light.cycles.is_portal:
        report.skipped(name, "a light portal only guides Cycles' sampling")
        return None
    strength = np.array(light.color, np.float64) * light.energy * 2.0 ** getattr(light, "exposure", 0.0)
    if getattr(light, "use_temperature", False):
        strength = strength * np.array(light.temperature_color)
    if light.use_nodes and light.node_tree is not None:
        strength = strength * _node_strength(light, name, report, distance)
    strength = report.finite(name, "its strength", strength)
    if not light.use_shadow:
        report.approximated(name, "a lamp without shadows casts shadows")
    if (strength < 0).any():
        report.approximated(name, "negative light is left out")
        strength = np.maximum(strength, 0)
    return strength if strength.any() else None


def _node_strength(light, name, report, distance) -> np.ndarray:
    output = graph.output_node(light.node_tree)
    if output is None:
        return np.zeros(3)
    evaluator = Evaluator(Points(distance=distance), ImageCache(report), report, name)
    return closure_at(NodeCall(evaluator, output), "Surface").emission.astype(np.float64)


def normalized(light) -> bool:
    """Whether energy means power (watts, or irradiance of a sun) rather than radiance times pi."""
    return getattr(light, "normalize", True)


def ball_power(light, strength):
    """Without "Normalize" Cycles takes the energy per square metre of the ball; a ball of radius 0 counts as 4."""
    if normalized(light):
        return strength
    return strength * (4 * math.pi * light.shadow_soft_size ** 2 if light.shadow_soft_size > 0 else 4.0)
