# SPDX-License-Identifier: GPL-3.0-or-later
"""Nodes that shape the light of a lamp: Light Falloff, IES Texture, and coordinates."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .node_call import NodeCall

WATT_PER_CANDELA = 4 * np.pi / 177.83  # of a lamp that shines evenly, by the luminous efficacy of D65, as in Cycles
FALLOFF = {"Quadratic": 0, "Linear": 1, "Constant": 2}  # power of the distance that takes the natural falloff back


@dataclass(frozen=True)
class LampPoints:
    """Where the light of a lamp is evaluated: all directions at all points of its surface, by broadcasting."""

    direction: np.ndarray          # (d, 1, 3) f32 unit directions away from the lamp, in its frame: it shines along -Z
    frame: np.ndarray            # (3, 3) f32 rotation from there to the world
    surface: np.ndarray | None     # (1, p, 3) f32, 0 to 1 in x and y across an area lamp; None: no surface
    distance: float | None       # to the center of the scene; None: infinitely far

    @property
    def normal(self) -> np.ndarray:
        """The normal of the lamp's surface; of a ball, the direction."""
        return self.direction if self.surface is None else np.float32((0, 0, -1))


def coordinate(n: NodeCall):
    """An output of Texture Coordinate or Geometry; None when it is not known of lamps."""
    lamp, name = n.points.lamp, n.output.name
    if name in ("UV", "Parametric") and lamp.surface is not None:
        return lamp.surface
    in_world = {"Normal": lamp.normal, "True Normal": lamp.normal, "Incoming": lamp.direction}
    if n.kind == "ShaderNodeNewGeometry" and name in in_world:
        return in_world[name] @ lamp.frame.T
    if n.kind == "ShaderNodeTexCoord" and name == "Normal":
        return lamp.normal
    n.approximated(f'"{name}" is not available for lights: 0.5 is used')
    return np.full(1, 0.5, np.float32)


def light_falloff(n: NodeCall):
    """Its value at the center of the scene: tokens fall off with the square of the distance."""
    distance = n.points.lamp.distance if n.points.lamp else 1.0
    if distance is None:
        return n["Strength"]
    power, square = FALLOFF[n.output.name], distance ** 2
    smooth = np.maximum(n["Smooth"], 0)
    if power or np.any(smooth > 0):
        n.approximated("its falloff is the usual one, with the right brightness at the center of what the camera sees")
    return n["Strength"] * distance ** power * square / np.maximum(smooth + square, 1e-30)


def ies_texture(n: NodeCall):
    profile = n.node.profile
    if profile is None:
        n.approximated("its IES profile cannot be read, so the light is dark: relink the file")
        return np.zeros(1, np.float32)
    direction = n.linked("Vector")
    if direction is None:
        direction = np.float32((0, 0, -1)) if n.points.lamp is None else n.points.lamp.direction
    length = np.linalg.norm(direction, axis=-1, keepdims=True)
    return n["Strength"] * profile(direction / np.maximum(length, 1e-12)) * np.float32(WATT_PER_CANDELA)


FUNCTIONS = {"ShaderNodeLightFalloff": light_falloff, "ShaderNodeTexIES": ies_texture}
