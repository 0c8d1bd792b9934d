# SPDX-License-Identifier: GPL-3.0-or-later
"""FLIP of low dynamic range pictures ("A Difference Evaluator for Alternating Images", Andersson et al. 2020).

Numbers and equations are the paper's: sections 4.1 (colour), 4.2 (features) and 4.3 (both together).
"""
from __future__ import annotations

import numpy as np

from .. import progress
from ..color import srgb_to_linear

PIXELS_PER_DEGREE = 67.02  # 0.7 m away from a 0.7 m wide display of 3840 pixels

# Contrast sensitivity: sum of a sqrt(pi / b) exp(-pi^2 r^2 / b), r in degrees; achromatic, red-green, blue-yellow.
SENSITIVITY = (((1.0, 0.0047),), ((1.0, 0.0053),), ((34.1, 0.04), (13.5, 0.025)))
COLOR_EXPONENT, FEATURE_EXPONENT = 0.7, 0.5
COMPRESSED_FROM, COMPRESSED_TO = 0.4, 0.95  # large colour differences take the last 5 % of the range
FEATURE_WIDTH = 0.082                       # degrees
BAND = 64                                   # rows at a time: what is computed for them stays in the processor's cache

XYZ = np.array([[10135552 / 24577794, 8788810 / 24577794, 4435075 / 24577794],
                [2613072 / 12288897, 8788810 / 12288897, 887015 / 12288897],
                [1425312 / 73733382, 8788810 / 73733382, 70074185 / 73733382]])  # from linear Rec.709
WHITE = XYZ.sum(1)
YCC = np.array([[0, 116, 0], [500, -500, 0], [0, 200, -200]]) @ (XYZ / WHITE[:, None])  # plus (-16, 0, 0)


def flip_map(reference: np.ndarray, test: np.ndarray, pixels_per_degree: float = PIXELS_PER_DEGREE) -> np.ndarray:
    """What an observer sees who flips between two sRGB-encoded pictures (H, W, 3) in [0, 1]: (H, W) f32 in [0, 1].

    Progress is reported, and may cancel.
    """
    linear = (srgb_to_linear(picture.astype(np.float32)) for picture in (reference, test))
    return flip_of_linear(*linear, pixels_per_degree)


def flip_of_linear(reference: np.ndarray, test: np.ndarray, pixels_per_degree: float) -> np.ndarray:
    """The same of pictures that are not encoded."""
    kernels = _Kernels(pixels_per_degree)
    edge = ((kernels.radius, kernels.radius), (kernels.radius, kernels.radius), (0, 0))
    padded = [np.pad(_opponent(picture), edge, "edge") for picture in (reference, test)]
    height = reference.shape[0]
    rows = []
    for top in range(0, height, BAND):
        progress.report(top / height)
        bottom = min(top + BAND, height) + 2 * kernels.radius
        rows.append(_flip_of_band(*(picture[top:bottom] for picture in padded), kernels))
    return np.concatenate(rows)


class _Kernels:
    """One-dimensional factors (2 radius + 1) of the paper's filters."""

    def __init__(self, pixels_per_degree: float):
        widest = max(b for terms in SENSITIVITY for _, b in terms)
        deviation = 0.5 * FEATURE_WIDTH * pixels_per_degree
        self.radius = int(np.ceil(3 * max(deviation, np.sqrt(widest / (2 * np.pi ** 2)) * pixels_per_degree)))
        x = np.arange(-self.radius, self.radius + 1, dtype=np.float64)
        inside = np.abs(x) <= np.ceil(3 * np.sqrt(widest / (2 * np.pi ** 2)) * pixels_per_degree)
        self.sensitivity = [_weighted([(a * np.pi / b, inside * np.exp(-(np.pi * x / pixels_per_degree) ** 2 / b))
                                       for a, b in terms]) for terms in SENSITIVITY]
        gauss = np.exp(-x ** 2 / (2 * deviation ** 2)) * (np.abs(x) <= np.ceil(3 * deviation))
        self.smooth = gauss / gauss.sum()
        self.first = _balanced(-x * gauss)
        self.second = _balanced((x ** 2 / deviation ** 2 - 1) * gauss)


def _weighted(terms: list[tuple[float, np.ndarray]]) -> list[tuple[float, np.ndarray]]:
    """(weight, factor) of a sum of separable filters, scaled so that all weights of the sum add up to 1."""
    total = sum(weight * factor.sum() ** 2 for weight, factor in terms)
    return [(weight * factor.sum() ** 2 / total, factor / factor.sum()) for weight, factor in terms]


def _balanced(kernel: np.ndarray) -> np.ndarray:
    """Positive weights that add up to 1 and negative ones that add up to -1."""
    return np.where(kernel > 0, kernel / kernel[kernel > 0].sum(), kernel / -kernel[kernel < 0].sum())


def _flip_of_band(reference: np.ndarray, test: np.ndarray, kernels: _Kernels) -> np.ndarray:
    """Two padded pictures in opponent colours, (H + 2 radius, W + 2 radius, 3) -> (H, W)."""
    color = _color_difference(_perceived(reference, kernels), _perceived(test, kernels))
    edges_r, points_r = _features(reference[..., 0], kernels)
    edges_t, points_t = _features(test[..., 0], kernels)
    feature = (np.maximum(np.abs(edges_r - edges_t), np.abs(points_r - points_t)) / np.sqrt(2)) ** FEATURE_EXPONENT
    return (color ** (1 - feature)).astype(np.float32)


def _opponent(linear: np.ndarray) -> np.ndarray:
    """Rec.709 -> YCxCz, f32."""
    ycc = linear.astype(np.float32) @ YCC.T.astype(np.float32)
    return ycc - np.array([16, 0, 0], np.float32)


def _perceived(ycc: np.ndarray, kernels: _Kernels) -> np.ndarray:
    """What the eye resolves of a padded picture, in L*a*b* with Hunt's effect: (H, W, 3)."""
    seen = np.stack([sum(weight * _filtered(ycc[..., c], factor, factor) for weight, factor in terms)
                     for c, terms in enumerate(kernels.sensitivity)], -1)
    rgb = (seen + np.array([16, 0, 0])) @ np.linalg.inv(YCC).T
    return _hunt_lab(np.clip(rgb, 0, 1))


def _hunt_lab(rgb: np.ndarray) -> np.ndarray:
    """Linear Rec.709 -> L*a*b*, colours weaker where it is dark."""
    t = rgb @ (XYZ / WHITE[:, None]).T
    t = np.where(t > (6 / 29) ** 3, np.cbrt(t), t / (3 * (6 / 29) ** 2) + 4 / 29)
    lightness = 116 * t[..., 1] - 16
    return np.stack([lightness, 5 * lightness * (t[..., 0] - t[..., 1]), 2 * lightness * (t[..., 1] - t[..., 2])], -1)


def _hyab(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    difference = a - b
    return np.abs(difference[..., 0]) + np.hypot(difference[..., 1], difference[..., 2])


def _color_difference(reference: np.ndarray, test: np.ndarray) -> np.ndarray:
    """Between pictures in L*a*b*, in [0, 1]."""
    largest = _hyab(_hunt_lab(np.array([0.0, 1, 0])), _hunt_lab(np.array([0.0, 0, 1]))) ** COLOR_EXPONENT
    difference = _hyab(reference, test) ** COLOR_EXPONENT / largest
    compressed = COMPRESSED_TO + (difference - COMPRESSED_FROM) / (1 - COMPRESSED_FROM) * (1 - COMPRESSED_TO)
    return np.where(difference < COMPRESSED_FROM, difference * COMPRESSED_TO / COMPRESSED_FROM, compressed)


def _features(luminance: np.ndarray, kernels: _Kernels) -> tuple[np.ndarray, np.ndarray]:
    """Strength of edges and of points in a padded luminance, each (H, W)."""
    luminance = (luminance + 16) / 116
    return tuple(np.hypot(_filtered(luminance, kernel, kernels.smooth), _filtered(luminance, kernels.smooth, kernel))
                 for kernel in (kernels.first, kernels.second))


def _filtered(x: np.ndarray, across: np.ndarray, down: np.ndarray) -> np.ndarray:
    """The separable filter where it lies inside: (H + 2 radius, W + 2 radius) -> (H, W)."""
    width, height = (size - across.size + 1 for size in (x.shape[1], x.shape[0]))
    x = sum(np.float32(w) * x[:, i:i + width] for i, w in enumerate(across) if w)
    return sum(np.float32(w) * x[i:i + height] for i, w in enumerate(down) if w)
