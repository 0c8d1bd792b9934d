# SPDX-License-Identifier: GPL-3.0-or-later
"""Colours: models with hue and saturation, Invert, Gamma, Brightness/Contrast, Separate and Combine, ramps, curves."""
from __future__ import annotations

import numpy as np

from ..data.arrays import divide_safely, join, mix_values
from ..data.blocks import Curve
from .node_call import NodeCall


def _hue(rgb, high, chroma):
    r, g, b = np.moveaxis(rgb, -1, 0)
    safe = np.where(chroma != 0, chroma, 1)
    hue = np.select([chroma == 0, high == r, high == g], [0 * r, (g - b) / safe, 2 + (b - r) / safe],
                    4 + (r - g) / safe)
    return hue / 6 % 1


def rgb_to_hsv(rgb: np.ndarray) -> np.ndarray:
    high = rgb.max(axis=-1)
    chroma = high - rgb.min(axis=-1)
    return np.stack([_hue(rgb, high, chroma), divide_safely(chroma, high), high], axis=-1)


def hsv_to_rgb(hsv: np.ndarray) -> np.ndarray:
    """Hues beyond 1 are magenta to red."""
    h, s, v = np.moveaxis(hsv, -1, 0)
    sixth = np.where(h == 1, 0, h) * 6
    sector = np.floor(sixth)
    up = sixth - sector
    low, down, rising = v * (1 - s), v * (1 - s * up), v * (1 - s * (1 - up))
    red = np.select([sector == i for i in range(5)], [v, down, low, low, rising], v)
    green = np.select([sector == i for i in range(5)], [rising, v, v, down, low], low)
    blue = np.select([sector == i for i in range(5)], [low, low, rising, v, v], down)
    return np.where((s == 0)[..., None], v[..., None], np.stack([red, green, blue], axis=-1))


def rgb_to_hsl(rgb: np.ndarray) -> np.ndarray:
    high, low = rgb.max(axis=-1), rgb.min(axis=-1)
    chroma, lightness = high - low, np.minimum((high + low) / 2, 1)
    saturation = divide_safely(chroma, np.where(lightness > 0.5, 2 - high - low, high + low))
    return np.stack([_hue(rgb, high, chroma), saturation, lightness], axis=-1)


def hsl_to_rgb(hsl: np.ndarray) -> np.ndarray:
    h, s, lightness = np.split(hsl, 3, axis=-1)
    ramp = np.clip((np.abs(h * 6 - [3, 2, 4]) - [1, 2, 2]) * [1, -1, -1], 0, 1)
    return (ramp - 0.5) * (1 - np.abs(2 * lightness - 1)) * s + lightness


TO_RGB = {"RGB": lambda color: color, "HSV": hsv_to_rgb, "HSL": hsl_to_rgb}
FROM_RGB = {"RGB": lambda color: color, "HSV": rgb_to_hsv, "HSL": rgb_to_hsl}


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
    shifted = join((h + n["Hue"] + 0.5) % 1, np.clip(s * n["Saturation"], 0, 1), v * n["Value"])
    return np.maximum(mix_values(color, hsv_to_rgb(shifted), factor), 0)


def separate_color(n: NodeCall):
    channel = list(n.node.outputs).index(n.output)
    return FROM_RGB[_mode(n)](n[0])[..., channel:channel + 1]


def combine_color(n: NodeCall):
    return TO_RGB[_mode(n)](join(*n.values()))


def _mode(n: NodeCall) -> str:
    return "HSV" if n.kind.endswith("HSV") else getattr(n.node, "mode", "RGB")


def rgb_to_bw(n: NodeCall):
    return n.conventions.luminance(n["Color"])


def color_ramp(n: NodeCall):
    factor, table = np.clip(n[0], 0, 1), n.node.color_ramp
    grid = np.linspace(0, 1, len(table))
    columns = (3,) if n.output.name == "Alpha" else (0, 1, 2)
    return np.concatenate([np.interp(factor, grid, table[:, c]) for c in columns], axis=-1)


def curves(n: NodeCall):
    """RGB and Vector Curves (the common curve first, then each channel's own), and Float Curve."""
    factor, value, mapping = n["Fac", "Factor"], n["Color", "Vector", "Value"], n.node.mapping
    own = list(mapping.curves)
    common = own.pop() if len(own) > 3 else None
    channels = [value[..., i] for i in range(value.shape[-1])]
    if common is not None:
        channels = [_through(common, mapping.extend, channel) for channel in channels]
    result = [_through(curve, mapping.extend, channel) for curve, channel in zip(own, channels, strict=True)]
    return mix_values(value, np.stack(result, axis=-1), factor)


def _through(curve: Curve, extend: str, x: np.ndarray) -> np.ndarray:
    """A curve at values of any shape; beyond its ends it goes on straight, or level."""
    first, last, table = curve.first, curve.last, curve.table
    grid = np.linspace(first, last, len(table))
    result = np.interp(x, grid, table)
    if extend == "EXTRAPOLATED" and last > first:
        step = grid[1] - grid[0]
        result = result + np.minimum(x - first, 0) * (table[1] - table[0]) / step
        result = result + np.maximum(x - last, 0) * (table[-1] - table[-2]) / step
    return result


FUNCTIONS = {
    "ShaderNodeInvert": invert, "ShaderNodeGamma": gamma, "ShaderNodeBrightContrast": brightness_contrast,
    "ShaderNodeHueSaturation": hue_saturation, "ShaderNodeRGBToBW": rgb_to_bw,
    "ShaderNodeSeparateColor": separate_color, "ShaderNodeSeparateRGB": separate_color,
    "ShaderNodeSeparateHSV": separate_color, "ShaderNodeCombineColor": combine_color,
    "ShaderNodeCombineRGB": combine_color, "ShaderNodeCombineHSV": combine_color, "ShaderNodeValToRGB": color_ramp,
    "ShaderNodeRGBCurve": curves, "ShaderNodeVectorCurve": curves, "ShaderNodeFloatCurve": curves,
}
