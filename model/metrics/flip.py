# SPDX-License-Identifier: GPL-3.0-or-later
"""FLIP, for pictures of low and of high dynamic range, and the colours of its maps.

Andersson et al. 2020, "FLIP: A Difference Evaluator for Alternating Images": its sections 4.1 (colour), 4.2 (features)
and 4.3 (both together). Andersson et al. 2021, "Visualizing Errors in Rendered High Dynamic Range Images".
"""
from __future__ import annotations

import numpy as np

from .. import progress
from ..pictures import HALF_MAX, LUMINANCE, srgb_to_linear

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

# ACES, fitted by one fraction of polynomials: (k0 x^2 + k1 x + k2) / (k3 x^2 + k4 x + k5)
NUMERATOR, DENOMINATOR = (0.6 * 0.6 * 2.51, 0.6 * 0.03, 0.0), (0.6 * 0.6 * 2.43, 0.6 * 0.59, 0.14)
BRIGHT = 0.85        # tone-mapped luminance of the brightest pixel at the first exposure, of the median at the last
DARKEST = 2.0 ** -23
FEWEST_EXPOSURES = 2

MAGMA = np.array([
    (0, 0, 4), (10, 8, 34), (29, 17, 71), (54, 16, 107), (81, 18, 124), (106, 28, 129), (131, 38, 129), (156, 46, 127),
    (183, 55, 121), (208, 65, 111), (231, 82, 99), (245, 107, 92), (252, 137, 97), (254, 167, 114), (254, 196, 136),
    (253, 226, 163), (252, 253, 191)], np.float32) / 255  # sRGB-encoded, at equal distances from 0 to 1


def flip_map(reference: np.ndarray, test: np.ndarray, pixels_per_degree: float = PIXELS_PER_DEGREE) -> np.ndarray:
    """(H, W) f32 in [0, 1]: the difference that an observer sees between two sRGB-encoded pictures (H, W, 3) in [0, 1].

    Progress is reported, and may cancel.
    """
    linear = (srgb_to_linear(picture.astype(np.float32)) for picture in (reference, test))
    return linear_flip_map(*linear, pixels_per_degree)


def linear_flip_map(reference: np.ndarray, test: np.ndarray, pixels_per_degree: float) -> np.ndarray:
    """`flip_map` of linear pictures."""
    kernels = _Kernels(pixels_per_degree)
    edge = ((kernels.radius, kernels.radius), (kernels.radius, kernels.radius), (0, 0))
    padded = [np.pad(_to_opponent(picture), edge, "edge") for picture in (reference, test)]
    height = reference.shape[0]
    rows = []
    for top in range(0, height, BAND):
        progress.report(top / height)
        bottom = min(top + BAND, height) + 2 * kernels.radius
        rows.append(_band_flip(*(picture[top:bottom] for picture in padded), kernels))
    return np.concatenate(rows)


class _Kernels:
    """One-dimensional factors (2 radius + 1) of the paper's filters."""

    def __init__(self, pixels_per_degree: float):
        widest = max(b for terms in SENSITIVITY for _, b in terms)
        deviation = 0.5 * FEATURE_WIDTH * pixels_per_degree
        self.radius = int(np.ceil(3 * max(deviation, np.sqrt(widest / (2 * np.pi ** 2)) * pixels_per_degree)))
        x = np.arange(-self.radius, self.radius + 1, dtype=np.float64)
        inside = np.abs(x) <= np.ceil(3 * np.sqrt(widest / (2 * np.pi ** 2)) * pixels_per_degree)
        self.sensitivity = [_normalize_sum([(a * np.pi / b, inside * np.exp(-(np.pi * x / pixels_per_degree) ** 2 / b))
                                       for a, b in terms]) for terms in SENSITIVITY]
        gauss = np.exp(-x ** 2 / (2 * deviation ** 2)) * (np.abs(x) <= np.ceil(3 * deviation))
        self.smooth = gauss / gauss.sum()
        self.first = _normalize_signed(-x * gauss)
        self.second = _normalize_signed((x ** 2 / deviation ** 2 - 1) * gauss)


def _normalize_sum(terms: list[tuple[float, np.ndarray]]) -> list[tuple[float, np.ndarray]]:
    """(weight, factor) of a sum of separable filters, scaled so that all weights of the sum add up to 1."""
    total = sum(weight * factor.sum() ** 2 for weight, factor in terms)
    return [(weight * factor.sum() ** 2 / total, factor / factor.sum()) for weight, factor in terms]


def _normalize_signed(kernel: np.ndarray) -> np.ndarray:
    """Positive weights that add up to 1 and negative ones that add up to -1."""
    return np.where(kernel > 0, kernel / kernel[kernel > 0].sum(), kernel / -kernel[kernel < 0].sum())


def _band_flip(reference: np.ndarray, test: np.ndarray, kernels: _Kernels) -> np.ndarray:
    """Two padded pictures in opponent colours, (H + 2 radius, W + 2 radius, 3) -> (H, W)."""
    color = _color_difference(_filter_as_eye(reference, kernels), _filter_as_eye(test, kernels))
    edges_r, points_r = _feature_strengths(reference[..., 0], kernels)
    edges_t, points_t = _feature_strengths(test[..., 0], kernels)
    feature = (np.maximum(np.abs(edges_r - edges_t), np.abs(points_r - points_t)) / np.sqrt(2)) ** FEATURE_EXPONENT
    return (color ** (1 - feature)).astype(np.float32)


def _to_opponent(linear: np.ndarray) -> np.ndarray:
    """Rec.709 -> YCxCz, f32."""
    ycc = linear.astype(np.float32) @ YCC.T.astype(np.float32)
    return ycc - np.array([16, 0, 0], np.float32)


def _filter_as_eye(ycc: np.ndarray, kernels: _Kernels) -> np.ndarray:
    """What the eye resolves of a padded picture, in L*a*b* with Hunt's effect: (H, W, 3)."""
    filtered = np.stack([sum(weight * _filter_separable(ycc[..., c], factor, factor) for weight, factor in terms)
                     for c, terms in enumerate(kernels.sensitivity)], -1)
    rgb = (filtered + np.array([16, 0, 0])) @ np.linalg.inv(YCC).T
    return _to_hunt_lab(np.clip(rgb, 0, 1))


def _to_hunt_lab(rgb: np.ndarray) -> np.ndarray:
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
    largest = _hyab(_to_hunt_lab(np.array([0.0, 1, 0])), _to_hunt_lab(np.array([0.0, 0, 1]))) ** COLOR_EXPONENT
    difference = _hyab(reference, test) ** COLOR_EXPONENT / largest
    compressed = COMPRESSED_TO + (difference - COMPRESSED_FROM) / (1 - COMPRESSED_FROM) * (1 - COMPRESSED_TO)
    return np.where(difference < COMPRESSED_FROM, difference * COMPRESSED_TO / COMPRESSED_FROM, compressed)


def _feature_strengths(luminance: np.ndarray, kernels: _Kernels) -> tuple[np.ndarray, np.ndarray]:
    """Strength of edges and of points in a padded luminance, each (H, W)."""
    luminance = (luminance + 16) / 116
    return tuple(np.hypot(_filter_separable(luminance, kernel, kernels.smooth),
                          _filter_separable(luminance, kernels.smooth, kernel))
                 for kernel in (kernels.first, kernels.second))


def _filter_separable(x: np.ndarray, across: np.ndarray, down: np.ndarray) -> np.ndarray:
    """The separable filter where it lies inside: (H + 2 radius, W + 2 radius) -> (H, W)."""
    width, height = (size - across.size + 1 for size in (x.shape[1], x.shape[0]))
    x = sum(np.float32(w) * x[:, i:i + width] for i, w in enumerate(across) if w)
    return sum(np.float32(w) * x[i:i + height] for i, w in enumerate(down) if w)


def hdr_flip_map(reference: np.ndarray, test: np.ndarray, pixels_per_degree: float = PIXELS_PER_DEGREE) -> np.ndarray:
    """(H, W) f32 in [0, 1]: the largest FLIP of each pixel of two scene-linear pictures (H, W, 3), at any exposure at
    which the reference shows something. NaN and negative values count as 0.

    Progress is reported, and may cancel.
    """
    reference, test = (np.clip(np.nan_to_num(picture, posinf=HALF_MAX), 0, HALF_MAX) for picture in (reference, test))
    largest = np.zeros(reference.shape[:2], np.float32)
    for exposure in progress.steps(choose_exposures(reference)):
        displayed = (_tone_map(picture * np.float32(2.0 ** exposure)) for picture in (reference, test))
        largest = np.maximum(largest, linear_flip_map(*displayed, pixels_per_degree))
    return largest


def choose_exposures(reference: np.ndarray) -> np.ndarray:
    """In stops, about one apart."""
    a, b, c = (n - BRIGHT * d for n, d in zip(NUMERATOR, DENOMINATOR))
    white = max(np.roots([a, b, c]).real)
    luminance = np.maximum(reference.astype(np.float64) @ LUMINANCE, 0)
    first, last = (np.log2(white / max(float(value), DARKEST)) for value in (luminance.max(), np.median(luminance)))
    return np.linspace(first, last, max(FEWEST_EXPOSURES, int(np.ceil(last - first))))


def _tone_map(linear: np.ndarray) -> np.ndarray:
    return np.clip(np.polyval(NUMERATOR, linear) / np.polyval(DENOMINATOR, linear), 0, 1)


def magma(values: np.ndarray) -> np.ndarray:
    """Values in [0, 1], any shape -> sRGB-encoded colours (..., 3) f32."""
    positions = np.linspace(0, 1, len(MAGMA))
    return np.stack([np.interp(values, positions, MAGMA[:, c]) for c in range(3)], -1).astype(np.float32)
