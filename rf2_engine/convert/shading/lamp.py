# SPDX-License-Identifier: GPL-3.0-or-later
"""Nodes that shape the light of a lamp: Light Falloff and IES Texture."""
from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np

from .node_call import NodeCall

WATT_PER_CANDELA = 4 * np.pi / 177.83  # of a lamp that shines evenly, by the luminous efficacy of D65, as in Cycles
FALLOFF = {"Quadratic": 0, "Linear": 1, "Constant": 2}  # power of the distance that takes the natural falloff back


def light_falloff(n: NodeCall):
    """What it is at the middle of what is looked at: tokens fall off with the square of the distance."""
    power, square = FALLOFF[n.output.name], n.points.distance ** 2
    smooth = np.maximum(n["Smooth"], 0)
    if power or np.any(smooth > 0):
        n.approximated("light falls off as usual, and is right at the middle of what is looked at")
    return n["Strength"] * n.points.distance ** power * square / np.maximum(smooth + square, 1e-30)


def ies_texture(n: NodeCall):
    node = n.node
    try:
        text = node.ies.as_string() if node.mode == "INTERNAL" else Path(bpy.path.abspath(node.filepath)).read_text(
            errors="replace")
        mean = mean_candela(text)
    except (AttributeError, OSError, ValueError, IndexError):
        n.approximated("its IES profile cannot be read, so the lamp is dark; relink the file")
        return np.zeros(1, np.float32)
    n.approximated("the light of its IES profile is spread evenly over all directions")
    return n["Strength"] * mean * WATT_PER_CANDELA


def mean_candela(text: str) -> float:
    """Mean over the sphere of the candelas in an IES file (LM-63, photometry of type C).

    Raises ValueError or IndexError when it is none.
    """
    _, tilt, rest = text.partition("TILT=")
    words = rest.replace(",", " ").split()
    if not tilt or words[0] != "NONE":
        raise ValueError("an IES file with a tilt or without photometry")
    numbers = np.array(words[1:], float)
    factor, (rows, columns) = numbers[2] * numbers[10] * numbers[11], numbers[3:5].astype(int)
    polar, around, candela = np.split(numbers[13:13 + rows + columns + rows * columns], [rows, rows + columns])
    candela = candela.reshape(columns, rows)
    along = candela[0] if columns == 1 else np.diff(around) @ (candela[1:] + candela[:-1]) / 2 / np.ptp(around)
    angle = (np.arange(1800) + 0.5) / 1800 * np.pi
    along = np.interp(angle, np.radians(polar), along, left=0, right=0)
    return float(factor * np.average(along, weights=np.sin(angle)))


FUNCTIONS = {"ShaderNodeLightFalloff": light_falloff, "ShaderNodeTexIES": ies_texture}
