# SPDX-License-Identifier: GPL-3.0-or-later
"""Noise Texture and White Noise Texture."""
from __future__ import annotations

import numpy as np

from ..arrays import joined
from ..node_call import NodeCall
from .fractal import KINDS, Fractal
from .hashing import color_of_floats, of_floats, offset
from .perlin import perlin

CHANNELS = {1: (1, 2), 2: (2, 3), 3: (3, 4), 4: (4, 5)}  # seeds of green and blue, by dimensions


def noise_texture(n: NodeCall):
    node = n.node
    at = n.coordinates_in(node.noise_dimensions) * n.get("Scale")
    dimensions, distortion = at.shape[-1], n.get("Distortion")
    fractal = Fractal(*(n.get(name, default)[..., 0] for name, default in (
        ("Detail", 2), ("Roughness", 0.5), ("Lacunarity", 2), ("Offset", 0), ("Gain", 1))), node.normalize)
    if np.any(distortion != 0):
        at = at + distortion * np.stack([perlin(at + offset(seed, dimensions)) for seed in range(dimensions)], axis=-1)
    places = [at]
    if n.output.type == "RGBA":
        places += [at + offset(seed, dimensions) for seed in CHANNELS[dimensions]]
    return np.stack([KINDS[node.noise_type](place, fractal) for place in places], axis=-1)


def white_noise(n: NodeCall):
    """Of its input as it is: without a link the input is not coordinates."""
    dimensions = n.node.noise_dimensions
    parts = [] if dimensions == "1D" else [n["Vector"][..., :2 if dimensions == "2D" else 3]]
    parts += [n["W"]] if dimensions in ("1D", "4D") else []
    values = np.moveaxis(joined(*parts), -1, 0)
    return color_of_floats(*values) if n.output.type == "RGBA" else of_floats(*values)[..., None]


FUNCTIONS = {"ShaderNodeTexNoise": noise_texture, "ShaderNodeTexWhiteNoise": white_noise}
