# SPDX-License-Identifier: GPL-3.0-or-later
"""Sums and products of octaves of Perlin noise (Ebert et al., Texturing and Modeling), as Blender's Noise Texture has.

All take points (..., d) and a `Fractal` whose numbers are arrays (...) or single, and return (...) f32. A fraction of
`detail` blends the last octave in.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...data.arrays import mix_values
from .perlin import perlin

MOST_OCTAVES = 15
NOTHING = 1e-3  # weight of an octave that is not worth adding


@dataclass
class Fractal:
    detail: np.ndarray
    roughness: np.ndarray
    lacunarity: np.ndarray
    offset: np.ndarray = np.float32(0)
    gain: np.ndarray = np.float32(1)
    normalized: bool = True

    def __post_init__(self):
        self.detail, self.roughness = np.clip(self.detail, 0, MOST_OCTAVES), np.maximum(self.roughness, 0)

    def octaves(self, at: np.ndarray):
        """The noise of each octave, its amplitude, and how much of it counts."""
        amplitude = frequency = np.float32(1)
        for octave in range(int(np.ceil(np.max(self.detail))) + 1):
            noise = perlin(at * np.asarray(frequency)[..., None])
            yield noise, amplitude, np.clip(self.detail - octave + 1, 0, 1)
            amplitude, frequency = amplitude * self.roughness, frequency * self.lacunarity


def fbm(at: np.ndarray, f: Fractal) -> np.ndarray:
    total, weight, value = np.float32(0), np.float32(0), np.float32(0)
    for noise, amplitude, share in f.octaves(at):
        total, weight = total + amplitude * noise, weight + amplitude
        value = mix_values(value, total / weight / 2 + 0.5 if f.normalized else total, share)
    return value


def multifractal(at: np.ndarray, f: Fractal) -> np.ndarray:
    value = np.float32(1)
    for noise, amplitude, share in f.octaves(at):
        value = value * (share * amplitude * noise + 1)
    return value


def hetero_terrain(at: np.ndarray, f: Fractal) -> np.ndarray:
    value = None
    for noise, amplitude, share in f.octaves(at):
        height = noise + f.offset
        value = height if value is None else value + share * height * amplitude * value
    return value


def hybrid_multifractal(at: np.ndarray, f: Fractal) -> np.ndarray:
    value, weight = np.float32(0), np.float32(1)
    for noise, amplitude, share in f.octaves(at):
        counts = (weight > NOTHING) * share
        signal, weight = (noise + f.offset) * amplitude, np.minimum(weight, 1)
        value = value + counts * weight * signal
        weight = weight * f.gain * signal
    return value


def ridged_multifractal(at: np.ndarray, f: Fractal) -> np.ndarray:
    value, signal = None, np.float32(0)
    for noise, amplitude, share in f.octaves(at):
        ridge = np.square(f.offset - np.abs(noise))
        if value is None:
            value = signal = ridge
            continue
        signal = ridge * np.clip(signal * f.gain, 0, 1)
        value = value + (share >= 1) * signal * amplitude
    return value


KINDS = {"FBM": fbm, "MULTIFRACTAL": multifractal, "HETERO_TERRAIN": hetero_terrain,
         "HYBRID_MULTIFRACTAL": hybrid_multifractal, "RIDGED_MULTIFRACTAL": ridged_multifractal}
