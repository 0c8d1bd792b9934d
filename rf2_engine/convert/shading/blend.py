# SPDX-License-Identifier: GPL-3.0-or-later
"""Mix: numbers, vectors, and colours in every blend mode."""
from __future__ import annotations

import numpy as np

from ..data.arrays import mixed
from .color_models import hsv_to_rgb, rgb_to_hsv
from .node_call import NodeCall


def _divide(a, b):
    return np.where(b != 0, a / np.where(b == 0, 1, b), a)


def _overlay(a, b):
    return np.where(a < 0.5, 2 * a * b, 1 - 2 * (1 - a) * (1 - b))


BLENDS = {  # what replaces `a` at factor 1; in between it is mixed in
    "MIX": lambda a, b: b, "ADD": lambda a, b: a + b, "SUBTRACT": lambda a, b: a - b, "MULTIPLY": lambda a, b: a * b,
    "DIVIDE": _divide, "SCREEN": lambda a, b: 1 - (1 - a) * (1 - b), "DIFFERENCE": lambda a, b: np.abs(a - b),
    "EXCLUSION": lambda a, b: a + b - 2 * a * b, "DARKEN": np.minimum, "LIGHTEN": np.maximum, "OVERLAY": _overlay,
    "LINEAR_LIGHT": lambda a, b: a + 2 * (b - 0.5),
    "SOFT_LIGHT": lambda a, b: (1 - a) * b * a + a * (1 - (1 - a) * (1 - b)),
}


def _burn(a, b, t):
    left = 1 - t + t * b
    return np.where(left <= 0, 0, np.clip(1 - (1 - a) / np.where(left <= 0, 1, left), 0, 1))


def _dodge(a, b, t):
    left = 1 - t * b
    return np.where(a == 0, a, np.where(left <= 0, 1, np.minimum(a / np.where(left <= 0, 1, left), 1)))


def _hue(a, b, t, channels=(0,)):
    """`a` in the hue of `b`, with its saturation too for two channels; what is grey has no hue to give."""
    a, b = np.broadcast_arrays(a, b)
    target, model = rgb_to_hsv(b), rgb_to_hsv(a)
    given = target[..., 1:2] != 0
    model[..., channels] = target[..., channels]
    return np.where(given, mixed(a, hsv_to_rgb(model), t), a)


def _channel(channel):
    def blend(a, b, t):
        a, b = np.broadcast_arrays(a, b)
        model, target = rgb_to_hsv(a), rgb_to_hsv(b)
        share = t[..., 0] * ((channel == 2) | (model[..., 1] != 0))
        model[..., channel] = mixed(model[..., channel], target[..., channel], share)
        return hsv_to_rgb(model)
    return blend


BY_FACTOR = {  # functions of the factor, too
    "BURN": _burn, "DODGE": _dodge, "HUE": _hue, "COLOR": lambda a, b, t: _hue(a, b, t, (0, 1)),
    "SATURATION": _channel(1), "VALUE": _channel(2),
}


def mix(n: NodeCall):
    node, new = n.node, n.kind == "ShaderNodeMix"
    factor, a, b = n["Factor", "Fac"], n["A", "Color1"], n["B", "Color2"]
    if not new or node.clamp_factor:
        factor = np.clip(factor, 0, 1)
    blend = node.blend_type if not new or node.data_type == "RGBA" else "MIX"
    if blend in BY_FACTOR:
        result = BY_FACTOR[blend](a, b, factor)
    else:
        result = mixed(a, BLENDS[blend](a, b), factor)
    if blend == "EXCLUSION":
        result = np.maximum(result, 0)
    clamped = node.data_type == "RGBA" and node.clamp_result if new else node.use_clamp
    return np.clip(result, 0, 1) if clamped else result


FUNCTIONS = {"ShaderNodeMix": mix, "ShaderNodeMixRGB": mix}
