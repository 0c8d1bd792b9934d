# SPDX-License-Identifier: GPL-3.0-or-later
"""Light of one wavelength or temperature as a colour: Wavelength and Blackbody."""
from __future__ import annotations

import numpy as np

from ..data.arrays import joined
from .node_call import NodeCall

XYZ_TO_REC709 = np.array([[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560],
                          [0.0556434, -0.2040259, 1.0572252]])
BRIGHTEST = 2.52      # channel of a spectral colour, which Blender makes 1
KELVIN = 800, 12000   # where black bodies stop to change
BLACK_BODIES = np.float32([  # Blender's, of luminance 1, measured at even steps of 1 / temperature
    (5.4138, 0, 0), (5.2688, 0, 0), (5.1181, 0, 0), (4.9611, 0, 0), (4.7969, 0, 0), (4.6263, 0.0316, 0),
    (4.4492, 0.0843, 0), (4.2662, 0.1387, 0), (4.0762, 0.1951, 0), (3.8809, 0.2529, 0), (3.6804, 0.3121, 0),
    (3.4747, 0.3726, 0), (3.2643, 0.434, 0), (3.0502, 0.4961, 0), (2.8336, 0.5584, 0), (2.615, 0.6204, 0.0036),
    (2.3938, 0.6817, 0.0464), (2.1738, 0.7413, 0.1042), (1.9557, 0.7983, 0.1829), (1.7403, 0.8516, 0.2894),
    (1.5302, 0.8996, 0.4319), (1.3288, 0.9403, 0.6211), (1.1392, 0.972, 0.8697), (0.9697, 0.9901, 1.1861),
    (0.8263, 0.9945, 1.5663)])


def blackbody(n: NodeCall):
    return n.conventions.from_rec709(blackbody_color(n[0]))


def blackbody_color(kelvin: np.ndarray) -> np.ndarray:
    """(..., 3) f32 scene-linear Rec.709 colour of black bodies of temperatures (..., 1)."""
    coldest, hottest = KELVIN
    step = (1 / coldest - 1 / np.clip(kelvin, *KELVIN)) / (1 / coldest - 1 / hottest) * (len(BLACK_BODIES) - 1)
    steps = np.arange(len(BLACK_BODIES))
    return joined(*(np.interp(step, steps, channel) for channel in BLACK_BODIES.T)).astype(np.float32)


def wavelength(n: NodeCall):
    n.approximated("the color of a wavelength is off by a few percent")
    xyz = np.moveaxis(observer(n[0][..., 0]), 0, -1)
    return np.maximum(n.conventions.from_rec709(xyz @ XYZ_TO_REC709.T / BRIGHTEST), 0)


def observer(nm: np.ndarray) -> np.ndarray:
    """(3, n) CIE 1931 colour matching at wavelengths in nanometres, piecewise Gaussian (Wyman, Sloan, Shirley 2013)."""
    def lobe(mean, below, above):
        return np.exp(-0.5 * ((nm - mean) / np.where(nm < mean, below, above)) ** 2)

    return np.stack([
        1.056 * lobe(599.8, 37.9, 31.0) + 0.362 * lobe(442.0, 16.0, 26.7) - 0.065 * lobe(501.1, 20.4, 26.2),
        0.821 * lobe(568.8, 46.9, 40.5) + 0.286 * lobe(530.9, 16.3, 31.1),
        1.217 * lobe(437.0, 11.8, 36.0) + 0.681 * lobe(459.0, 26.0, 13.8)])


FUNCTIONS = {"ShaderNodeBlackbody": blackbody, "ShaderNodeWavelength": wavelength}
