# SPDX-License-Identifier: GPL-3.0-or-later
"""Numbers: Math, Map Range, Clamp, Separate and Combine XYZ."""
from __future__ import annotations

import numpy as np

from ..data.arrays import divided, joined, smoothstep
from .node_call import NodeCall


def _power(a, b):
    """0 where it is not defined."""
    return np.nan_to_num(np.power(a, b), posinf=0.0, neginf=0.0)


def _logarithm(a, b):
    known = (a > 0) & (b > 0)
    return np.where(known, divided(np.log(np.where(known, a, 1)), np.log(np.where(known, b, 1))), 0)


def _wrapped(value, high, low):
    span = high - low
    return np.where(span != 0, value - span * np.floor(divided(value - low, span)), low)


def _modulo(a, b):
    return np.fmod(a, np.where(b == 0, 1, b)) * (b != 0)


def _smooth_minimum(a, b, width):
    near = divided(np.maximum(width - np.abs(a - b), 0), width)
    return np.minimum(a, b) - near ** 3 * width / 6


MATHS = {
    "ADD": lambda a, b, c: a + b, "SUBTRACT": lambda a, b, c: a - b, "MULTIPLY": lambda a, b, c: a * b,
    "DIVIDE": lambda a, b, c: divided(a, b), "MULTIPLY_ADD": lambda a, b, c: a * b + c,
    "POWER": lambda a, b, c: _power(a, b), "SQRT": lambda a, b, c: np.sqrt(np.maximum(a, 0)),
    "INVERSE_SQRT": lambda a, b, c: _power(np.maximum(a, 0), np.float32(-0.5)),
    "LOGARITHM": lambda a, b, c: _logarithm(a, b),
    "EXPONENT": lambda a, b, c: np.exp(np.minimum(a, 80)), "ABSOLUTE": lambda a, b, c: np.abs(a),
    "MINIMUM": lambda a, b, c: np.minimum(a, b), "MAXIMUM": lambda a, b, c: np.maximum(a, b),
    "LESS_THAN": lambda a, b, c: np.float32(a < b), "GREATER_THAN": lambda a, b, c: np.float32(a > b),
    "SIGN": lambda a, b, c: np.sign(a), "COMPARE": lambda a, b, c: np.float32(np.abs(a - b) <= np.maximum(c, 1.2e-7)),
    "ROUND": lambda a, b, c: np.floor(a + 0.5), "FLOOR": lambda a, b, c: np.floor(a),
    "CEIL": lambda a, b, c: np.ceil(a), "TRUNC": lambda a, b, c: np.trunc(a), "FRACT": lambda a, b, c: a - np.floor(a),
    "MODULO": lambda a, b, c: _modulo(a, b), "WRAP": _wrapped,
    "FLOORED_MODULO": lambda a, b, c: np.where(b != 0, a - np.floor(divided(a, b)) * b, 0),
    "SMOOTH_MIN": lambda a, b, c: _smooth_minimum(a, b, np.maximum(c, 0)),
    "SMOOTH_MAX": lambda a, b, c: -_smooth_minimum(-a, -b, np.maximum(c, 0)),
    "SNAP": lambda a, b, c: np.floor(divided(a, b)) * b,
    "PINGPONG": lambda a, b, c: np.where(b == 0, 0, np.abs(np.mod(a - b, np.where(b == 0, 1, 2 * b)) - b)),
    "SINE": lambda a, b, c: np.sin(a), "COSINE": lambda a, b, c: np.cos(a), "TANGENT": lambda a, b, c: np.tan(a),
    "ARCSINE": lambda a, b, c: np.arcsin(np.clip(a, -1, 1)), "ARCCOSINE": lambda a, b, c: np.arccos(np.clip(a, -1, 1)),
    "ARCTANGENT": lambda a, b, c: np.arctan(a), "ARCTAN2": lambda a, b, c: np.arctan2(a, b),
    "SINH": lambda a, b, c: np.sinh(a), "COSH": lambda a, b, c: np.cosh(a), "TANH": lambda a, b, c: np.tanh(a),
    "RADIANS": lambda a, b, c: np.radians(a), "DEGREES": lambda a, b, c: np.degrees(a),
}


def math(n: NodeCall):
    result = MATHS[n.node.operation](*n.values())
    return np.clip(result, 0, 1) if n.node.use_clamp else result


def map_range(n: NodeCall):
    ends = [n[end, end.replace(" ", "_") + "_FLOAT3"] for end in ("From Min", "From Max", "To Min", "To Max")]
    value, (low, high, to_low, to_high), kind = n["Value", "Vector"], ends, n.node.interpolation_type
    t = divided(value - low, high - low)
    if kind == "STEPPED":
        steps = n["Steps"]
        t = np.where(steps > 0, np.floor(t * (steps + 1)) / np.where(steps > 0, steps, 1), 0)
    elif kind == "SMOOTHSTEP":
        t = smoothstep(t)
    elif kind == "SMOOTHERSTEP":
        t = np.clip(t, 0, 1)
        t = t ** 3 * (t * (6 * t - 15) + 10)
    result = to_low + t * (to_high - to_low)
    if n.output.type == "VALUE":
        result = np.where(low != high, result, 0)
    return np.clip(result, np.minimum(to_low, to_high), np.maximum(to_low, to_high)) if n.node.clamp else result


def clamp(n: NodeCall):
    value, low, high = n.values()
    if n.node.clamp_type == "RANGE":
        low, high = np.minimum(low, high), np.maximum(low, high)
    return np.minimum(np.maximum(value, low), high)


def separate(n: NodeCall):
    channel = list(n.node.outputs).index(n.output)
    return n[0][..., channel:channel + 1]


def combine(n: NodeCall):
    return joined(*n.values())


FUNCTIONS = {
    "ShaderNodeMath": math, "ShaderNodeMapRange": map_range, "ShaderNodeClamp": clamp,
    "ShaderNodeSeparateXYZ": separate, "ShaderNodeCombineXYZ": combine,
}
