# SPDX-License-Identifier: GPL-3.0-or-later
"""Numbers and vectors: Math, Vector Math, Map Range, Clamp, Separate and Combine XYZ."""
from __future__ import annotations

import numpy as np

from .node_call import NodeCall


def _divide(a, b):
    return np.divide(a, b, out=np.zeros(np.broadcast(a, b).shape, np.float32), where=b != 0)


def _power(a, b):
    with np.errstate(all="ignore"):
        return np.nan_to_num(np.power(a, b), posinf=0.0, neginf=0.0)


MATHS = {
    "ADD": lambda a, b, c: a + b, "SUBTRACT": lambda a, b, c: a - b, "MULTIPLY": lambda a, b, c: a * b,
    "DIVIDE": lambda a, b, c: _divide(a, b), "MULTIPLY_ADD": lambda a, b, c: a * b + c,
    "POWER": lambda a, b, c: _power(a, b), "SQRT": lambda a, b, c: np.sqrt(np.maximum(a, 0)),
    "INVERSE_SQRT": lambda a, b, c: _power(np.maximum(a, 0), np.float32(-0.5)),
    "LOGARITHM": lambda a, b, c: _divide(np.log(np.maximum(a, 1e-30)), np.log(np.maximum(b, 1e-30))),
    "EXPONENT": lambda a, b, c: np.exp(np.minimum(a, 80)), "ABSOLUTE": lambda a, b, c: np.abs(a),
    "MINIMUM": lambda a, b, c: np.minimum(a, b), "MAXIMUM": lambda a, b, c: np.maximum(a, b),
    "LESS_THAN": lambda a, b, c: np.float32(a < b), "GREATER_THAN": lambda a, b, c: np.float32(a > b),
    "SIGN": lambda a, b, c: np.sign(a), "COMPARE": lambda a, b, c: np.float32(np.abs(a - b) <= np.maximum(c, 1e-5)),
    "ROUND": lambda a, b, c: np.floor(a + 0.5), "FLOOR": lambda a, b, c: np.floor(a),
    "CEIL": lambda a, b, c: np.ceil(a), "TRUNC": lambda a, b, c: np.trunc(a), "FRACT": lambda a, b, c: a - np.floor(a),
    "MODULO": lambda a, b, c: np.fmod(a, np.where(b == 0, 1, b)) * (b != 0),
    "FLOORED_MODULO": lambda a, b, c: a - np.floor(_divide(a, b)) * b,
    "SNAP": lambda a, b, c: np.floor(_divide(a, b)) * b,
    "PINGPONG": lambda a, b, c: np.where(b == 0, 0, np.abs(np.mod(a - b, np.where(b == 0, 1, 2 * b)) - b)),
    "SINE": lambda a, b, c: np.sin(a), "COSINE": lambda a, b, c: np.cos(a), "TANGENT": lambda a, b, c: np.tan(a),
    "ARCSINE": lambda a, b, c: np.arcsin(np.clip(a, -1, 1)), "ARCCOSINE": lambda a, b, c: np.arccos(np.clip(a, -1, 1)),
    "ARCTANGENT": lambda a, b, c: np.arctan(a), "ARCTAN2": lambda a, b, c: np.arctan2(a, b),
    "RADIANS": lambda a, b, c: np.radians(a), "DEGREES": lambda a, b, c: np.degrees(a),
}


def _dot(a, b):
    return np.sum(a * b, axis=-1, keepdims=True)


def _length(a):
    return np.sqrt(_dot(a, a))


VECTOR_MATHS = {
    "ADD": lambda a, b: a + b, "SUBTRACT": lambda a, b: a - b, "MULTIPLY": lambda a, b: a * b, "DIVIDE": _divide,
    "CROSS_PRODUCT": lambda a, b: np.cross(a, b), "DOT_PRODUCT": _dot, "LENGTH": lambda a, b: _length(a),
    "DISTANCE": lambda a, b: _length(a - b), "NORMALIZE": lambda a, b: _divide(a, _length(a)),
    "ABSOLUTE": lambda a, b: np.abs(a), "MINIMUM": np.minimum, "MAXIMUM": np.maximum,
    "FLOOR": lambda a, b: np.floor(a), "CEIL": lambda a, b: np.ceil(a), "FRACTION": lambda a, b: a - np.floor(a),
    "MODULO": lambda a, b: MATHS["MODULO"](a, b, None), "SINE": lambda a, b: np.sin(a),
    "COSINE": lambda a, b: np.cos(a), "TANGENT": lambda a, b: np.tan(a),
    "REFLECT": lambda a, b: a - 2 * _dot(a, _divide(b, _length(b))) * _divide(b, _length(b)),
}


def math(n: NodeCall):
    operands = n.values()
    if n.node.operation not in MATHS:
        n.approximated(f"Math {n.node.operation.title()} is not evaluated, its first input is used")
        return operands[0]
    result = MATHS[n.node.operation](*operands)
    return np.clip(result, 0, 1) if n.node.use_clamp else result


def vector_math(n: NodeCall):
    if n.node.operation == "SCALE":
        return n[0] * n["Scale"]
    if n.node.operation not in VECTOR_MATHS:
        n.approximated(f"Vector Math {n.node.operation.title()} is not evaluated, its first input is used")
        return n[0]
    return VECTOR_MATHS[n.node.operation](n[0], n[1])


def map_range(n: NodeCall):
    low, high, to_low, to_high = n["From Min"], n["From Max"], n["To Min"], n["To Max"]
    kind, t = n.node.interpolation_type, _divide(n["Value", "Vector"] - low, high - low)
    if kind == "STEPPED":
        steps = np.maximum(n["Steps"], 1)
        t = np.floor(t * (steps + 1)) / steps
    elif kind in ("SMOOTHSTEP", "SMOOTHERSTEP"):
        t = np.clip(t, 0, 1)
        t = t * t * (3 - 2 * t) if kind == "SMOOTHSTEP" else t ** 3 * (t * (6 * t - 15) + 10)
    return to_low + (np.clip(t, 0, 1) if n.node.clamp else t) * (to_high - to_low)


def clamp(n: NodeCall):
    value, low, high = n.values()
    if n.node.clamp_type == "RANGE":
        low, high = np.minimum(low, high), np.maximum(low, high)
    return np.minimum(np.maximum(value, low), high)


def separate(n: NodeCall):
    channel = list(n.node.outputs).index(n.output)
    return n[0][..., channel:channel + 1]


def combine(n: NodeCall):
    return np.concatenate(np.broadcast_arrays(*n.values()), axis=-1)


FUNCTIONS = {
    "ShaderNodeMath": math, "ShaderNodeVectorMath": vector_math, "ShaderNodeMapRange": map_range,
    "ShaderNodeClamp": clamp, "ShaderNodeSeparateXYZ": separate, "ShaderNodeCombineXYZ": combine,
}
