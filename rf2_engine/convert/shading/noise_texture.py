# SPDX-License-Identifier: GPL-3.0-or-later
"""Noise, White Noise and Gabor Texture."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..data.arrays import TINIEST, join, unit
from .node_call import NodeCall
from .noise.fractal import KINDS, Fractal
from .noise.gabor import IMPULSES, phasor
from .noise.hashing import hash_color, hash_floats, offset
from .noise.lattice import in_blocks
from .noise.perlin import perlin

CHANNELS = {1: (1, 2), 2: (2, 3), 3: (3, 4), 4: (4, 5)}  # seeds of green and blue, by dimensions
DEVIATIONS = 6            # how many of them the value spans
SQUARED_KERNEL = {2: 1 / 4, 3: 1 / (4 * np.sqrt(2))}  # of the Gabor kernel: integral over the plane or space
NOTHING = [np.zeros((), np.float32)] * 2  # where a texture feeds itself
LEAST_FREQUENCY = 1e-3


def noise_texture(n: NodeCall):
    node = n.node
    at = n.coordinates_in(node.noise_dimensions) * n.get("Scale")
    dimensions, distortion = at.shape[-1], n.get("Distortion")
    fractal = Fractal(*(n.get(name, default)[..., 0] for name, default in (
        ("Detail", 2), ("Roughness", 0.5), ("Lacunarity", 2), ("Offset", 0), ("Gain", 1))), node.normalize)
    if np.any(distortion != 0):
        at = at + distortion * np.stack([perlin(at + offset(seed, dimensions)) for seed in range(dimensions)], axis=-1)
    positions = [at]
    if n.output.type == "RGBA":
        positions += [at + offset(seed, dimensions) for seed in CHANNELS[dimensions]]
    return np.stack([KINDS[node.noise_type](points, fractal) for points in positions], axis=-1)


def white_noise(n: NodeCall):
    """White Noise hashes its input, which without a link is the socket's value, not coordinates."""
    dimensions = n.node.noise_dimensions
    parts = [] if dimensions == "1D" else [n["Vector"][..., :2 if dimensions == "2D" else 3]]
    parts += [n["W"]] if dimensions in ("1D", "4D") else []
    values = np.moveaxis(join(*parts), -1, 0)
    return hash_color(*values) if n.output.type == "RGBA" else hash_floats(*values)[..., None]


def gabor_texture(n: NodeCall):
    """All outputs come of the same sums."""
    dimensions = 2 if n.node.gabor_type == "2D" else 3
    real, imaginary = n.evaluator.evaluate_once(replace(n, output=n.node.outputs[0]), _gabor_sums, NOTHING)
    spread = DEVIATIONS * np.sqrt(IMPULSES * SQUARED_KERNEL[dimensions] / 2)
    if n.output.name == "Value":
        result = imaginary / spread / 2 + 0.5
    elif n.output.name == "Phase":
        result = (np.arctan2(imaginary, real) + np.pi) / (2 * np.pi)
    else:
        result = np.hypot(real, imaginary) / spread
    return result[..., None]


def _gabor_sums(n: NodeCall) -> list[np.ndarray]:
    """Real and imaginary part, (...) each."""
    dimensions = 2 if n.node.gabor_type == "2D" else 3
    at = (n.coordinates()[..., :dimensions] * n["Scale"]).astype(np.float32)
    frequency = np.maximum(n["Frequency"], LEAST_FREQUENCY)[..., 0]
    isotropy = 1 - np.clip(n["Anisotropy"], 0, 1)[..., 0]
    turn = n["Orientation"]
    if dimensions == 3:
        x, y, z = np.moveaxis(unit(turn), -1, 0)
        azimuth = np.arccos(np.clip(x / np.maximum(np.hypot(x, y), TINIEST), -1, 1))
        angles = np.arccos(np.clip(z, -1, 1)), np.sign(y) * azimuth
    else:
        angles = (turn[..., 0],)
    return in_blocks(phasor, at, frequency, isotropy, *angles)


FUNCTIONS = {"ShaderNodeTexNoise": noise_texture, "ShaderNodeTexWhiteNoise": white_noise,
             "ShaderNodeTexGabor": gabor_texture}
