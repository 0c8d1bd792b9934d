# SPDX-License-Identifier: GPL-3.0-or-later
"""Colours: Mix, Invert, Gamma, Brightness/Contrast, Hue/Saturation, Separate and Combine Color, ramps and curves."""
from __future__ import annotations

import numpy as np

from .node_call import NodeCall

TABLE_SIZE = 1024


def _safe_divide(a, b):
    return np.where(b != 0, a / np.where(b == 0, 1, b), a)


def _overlay(a, b):
    return np.where(a < 0.5, 2 * a * b, 1 - 2 * (1 - a) * (1 - b))


BLENDS = {  # what replaces `a` at factor 1
    "MIX": lambda a, b: b, "ADD": lambda a, b: a + b, "SUBTRACT": lambda a, b: a - b, "MULTIPLY": lambda a, b: a * b,
    "DIVIDE": _safe_divide, "SCREEN": lambda a, b: 1 - (1 - a) * (1 - b), "DIFFERENCE": lambda a, b: np.abs(a - b),
    "EXCLUSION": lambda a, b: np.maximum(a + b - 2 * a * b, 0), "DARKEN": np.minimum, "LIGHTEN": np.maximum,
    "OVERLAY": _overlay, "LINEAR_LIGHT": lambda a, b: a + 2 * (b - 0.5),
    "SOFT_LIGHT": lambda a, b: (1 - a) * b * a + a * (1 - (1 - a) * (1 - b)),
}


def mix(n: NodeCall):
    node, new = n.node, n.kind == "ShaderNodeMix"
    factor, a, b = n["Factor", "Fac"], n["A", "Color1"], n["B", "Color2"]
    if node.clamp_factor if new else True:
        factor = np.clip(factor, 0, 1)
    blend = node.blend_type if not new or node.data_type == "RGBA" else "MIX"
    if blend not in BLENDS:
        n.approximated(f"blend mode {blend.title()} is evaluated as Mix")
    result = (1 - factor) * a + factor * BLENDS.get(blend, BLENDS["MIX"])(a, b)
    return np.clip(result, 0, 1) if (node.clamp_result if new else node.use_clamp) else result


def invert(n: NodeCall):
    color = n["Color"]
    return color + n["Fac", "Factor"] * (1 - 2 * color)


def gamma(n: NodeCall):
    color, exponent = n.values()
    return np.where(color > 0, np.power(np.maximum(color, 1e-30), exponent), color)


def brightness_contrast(n: NodeCall):
    color, brightness, contrast = n.values()
    return np.maximum((1 + contrast) * color + brightness - contrast / 2, 0)


def hue_saturation(n: NodeCall):
    factor, color = n["Fac", "Factor"], n["Color"]
    h, s, v = np.split(rgb_to_hsv(color), 3, axis=-1)
    hsv = np.broadcast_arrays((h + n["Hue"] + 0.5) % 1, np.clip(s * n["Saturation"], 0, 1), v * n["Value"])
    return np.maximum((1 - factor) * color + factor * hsv_to_rgb(np.concatenate(hsv, axis=-1)), 0)


def rgb_to_hsv(rgb: np.ndarray) -> np.ndarray:
    """(..., 3) -> (..., 3), hue in [0, 1)."""
    r, g, b = np.moveaxis(rgb, -1, 0)
    high, low = rgb.max(axis=-1), rgb.min(axis=-1)
    chroma = np.where(high > low, high - low, 1)
    hue = np.select([high == low, high == r, high == g], [0 * r, (g - b) / chroma, 2 + (b - r) / chroma],
                    4 + (r - g) / chroma)
    return np.stack([hue / 6 % 1, np.where(high > 0, (high - low) / np.where(high > 0, high, 1), 0), high], axis=-1)


def hsv_to_rgb(hsv: np.ndarray) -> np.ndarray:
    """(..., 3) -> (..., 3)."""
    h, s, v = hsv[..., :1], hsv[..., 1:2], hsv[..., 2:]
    ramp = np.clip(np.abs(h * 6 - np.array([3, 2, 4])) * np.array([1, -1, -1]) + np.array([-1, 2, 2]), 0, 1)
    return v * (1 - s + s * ramp)


def separate_color(n: NodeCall):
    color, mode = n[0], getattr(n.node, "mode", "RGB")
    if mode == "HSV":
        color = rgb_to_hsv(color)
    elif mode != "RGB":
        n.approximated(f"mode {mode} is evaluated as RGB")
    channel = list(n.node.outputs).index(n.output)
    return color[..., channel:channel + 1]


def combine_color(n: NodeCall):
    color, mode = np.concatenate(np.broadcast_arrays(*n.values()), axis=-1), getattr(n.node, "mode", "RGB")
    if mode == "HSV":
        return hsv_to_rgb(color)
    if mode != "RGB":
        n.approximated(f"mode {mode} is evaluated as RGB")
    return color


def color_ramp(n: NodeCall):
    factor = np.clip(n[0], 0, 1)
    grid = np.linspace(0, 1, TABLE_SIZE)
    table = np.array([n.node.color_ramp.evaluate(x) for x in grid], np.float32)
    columns = (3,) if n.output.name == "Alpha" else (0, 1, 2)
    return np.concatenate([np.interp(factor, grid, table[:, c]) for c in columns], axis=-1)


def curves(n: NodeCall):
    """RGB Curves (each channel through its own curve, then the common one) and Float Curve."""
    factor, value, mapping = n["Fac", "Factor"], n["Color", "Value"], n.node.mapping
    mapping.initialize()
    own = list(mapping.curves)
    common = own.pop() if len(own) > 1 else None
    grid = np.linspace(0, 1, TABLE_SIZE)

    def through(curve, x):
        return np.interp(x, grid, [mapping.evaluate(curve, g) for g in grid])

    channels = [value[..., i] if common is None else through(common, value[..., i]) for i in range(value.shape[-1])]
    result = np.stack([through(curve, channel) for curve, channel in zip(own, channels, strict=True)], axis=-1)
    return (1 - factor) * value + factor * result


FUNCTIONS = {
    "ShaderNodeMix": mix, "ShaderNodeMixRGB": mix, "ShaderNodeInvert": invert, "ShaderNodeGamma": gamma,
    "ShaderNodeBrightContrast": brightness_contrast, "ShaderNodeHueSaturation": hue_saturation,
    "ShaderNodeSeparateColor": separate_color, "ShaderNodeSeparateRGB": separate_color,
    "ShaderNodeCombineColor": combine_color, "ShaderNodeCombineRGB": combine_color, "ShaderNodeValToRGB": color_ramp,
    "ShaderNodeRGBCurve": curves, "ShaderNodeFloatCurve": curves,
}
