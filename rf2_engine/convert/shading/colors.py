# SPDX-License-Identifier: GPL-3.0-or-later
"""Colours: Invert, Gamma, Brightness/Contrast, Hue/Saturation, Separate and Combine Color, ramps and curves."""
from __future__ import annotations

import numpy as np

from ..data.arrays import joined, mixed
from ..data.nodes import Curve
from .color_models import FROM_RGB, TO_RGB, hsv_to_rgb, rgb_to_hsv
from .node_call import NodeCall


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
    shifted = joined((h + n["Hue"] + 0.5) % 1, np.clip(s * n["Saturation"], 0, 1), v * n["Value"])
    return np.maximum(mixed(color, hsv_to_rgb(shifted), factor), 0)


def separate_color(n: NodeCall):
    channel = list(n.node.outputs).index(n.output)
    return FROM_RGB[_mode(n)](n[0])[..., channel:channel + 1]


def combine_color(n: NodeCall):
    return TO_RGB[_mode(n)](joined(*n.values()))


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
    return mixed(value, np.stack(result, axis=-1), factor)


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
