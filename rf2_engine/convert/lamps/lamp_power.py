# SPDX-License-Identifier: GPL-3.0-or-later
"""The radiance of a lamp: energy, colour, exposure, temperature, nodes and "Normalize" (measured in Cycles)."""
from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ..data.report import Report
from ..shading import graph
from ..shading.evaluate import Evaluator
from ..shading.lamp_nodes import LampPoints
from ..shading.node_call import NodeCall
from ..shading.points import Points
from ..shading.surface import closure_at
from .beams import sphere

FALLOFF_NODE = "ShaderNodeLightFalloff"
TEXTURE_SIZE = 16  # across the surface of an area lamp


@dataclass(frozen=True)
class LampLight:
    """Energy times colour, exposure, temperature and node tree."""

    strength: np.ndarray                  # (3,) mean over the surface, and over all directions if they are alike
    directions: np.ndarray | None = None  # (n, 3) strength in the directions of `sphere(n)`, in the lamp's frame
    texture: np.ndarray | None = None      # (TEXTURE_SIZE, TEXTURE_SIZE, 3) [y, x] of an area lamp: mean 1, or 0
    is_rough_guess: bool = False  # whether it falls off otherwise


def compute_lamp_light(light, name: str, report: Report, frame: np.ndarray, distance: float) -> LampLight | None:
    """The light of a Lamp (data/blocks.py); None when it emits none.

    frame: (3, 3) rotation of the lamp; distance: to the center of the scene, for lamps that do not fall off
    with its square.
    """
    if light.is_portal:  # it only guides Cycles' sampling
        return None
    strength = np.array(light.color, np.float64) * light.energy * 2.0 ** getattr(light, "exposure", 0.0)
    if getattr(light, "use_temperature", False):
        strength = strength * np.array(light.temperature_color)
    if light.node_tree is not None:
        strength = strength * _emission(light, name, report, frame, distance)
    strength = np.where(np.isinf(strength), np.nan, strength)  # Cycles drops light that is not finite
    strength = report.finite(name, "its strength", strength)
    if (strength < 0).any():
        report.approximated(name, "negative light is ignored")
        strength = np.maximum(strength, 0)
    if not strength.any():
        return None
    return replace(_parts(strength), is_rough_guess=_has_falloff(light))


def _has_falloff(light) -> bool:
    return light.node_tree is not None and any(node.bl_idname == FALLOFF_NODE for node in light.node_tree.nodes)


def _emission(light, name, report: Report, frame, distance) -> np.ndarray:
    """(3,), or (directions, points, 3), either of them perhaps 1."""
    output = graph.output_node(light.node_tree)
    if output is None:
        return np.zeros(3)
    toward = sphere() if light.type != "SUN" else np.float32([(0, 0, -1)])
    points = LampPoints(toward[:, None], frame.astype(np.float32), _surface_points() if light.type == "AREA" else None,
                        None if light.type == "SUN" else distance)
    evaluator = Evaluator(Points(lamp=points), light.node_tree.conventions, report, name)
    emission = closure_at(NodeCall(evaluator, output), "Surface").emission.astype(np.float64)
    if light.type == "SUN" or emission.size == 3:
        return emission.reshape(3)
    return emission.reshape(-1, *emission.shape[-2:])


def _surface_points() -> np.ndarray:
    across = (np.arange(TEXTURE_SIZE) + 0.5) / TEXTURE_SIZE
    y, x = (a.ravel() for a in np.meshgrid(across, across, indexing="ij"))
    return np.stack([x, y, 0 * x], axis=-1)[None].astype(np.float32)


def _parts(strength: np.ndarray) -> LampLight:
    if strength.ndim == 1:
        return LampLight(strength)
    count, points = strength.shape[:2]
    facing = np.maximum(-sphere(count)[:, 2], 0) if count > 1 else None
    surface = np.average(strength, axis=0, weights=facing)
    mean = surface.mean(axis=0)
    share = np.divide(surface, mean, out=np.zeros_like(surface), where=mean > 0)
    return LampLight(mean, strength.mean(axis=1) if count > 1 else None,
                     share.reshape(TEXTURE_SIZE, TEXTURE_SIZE, 3) if points > 1 else None)


def normalized(light) -> bool:
    """Whether energy means power (watts, or irradiance of a sun) rather than radiance times pi."""
    return getattr(light, "normalize", True)


def ball_power(light, strength):
    """The power of a ball. Without Normalize, energy is that of a square metre; a ball of radius 0 has 4 of them."""
    if normalized(light):
        return strength
    return strength * (4 * math.pi * light.shadow_soft_size ** 2 if light.shadow_soft_size > 0 else 4.0)
