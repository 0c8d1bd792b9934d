# SPDX-License-Identifier: GPL-3.0-or-later
"""The colour of a clear sky by formulas ("A Practical Analytic Model for Daylight", Preetham et al. 1999)."""
from __future__ import annotations

import numpy as np

from .spectrum import XYZ_TO_REC709

BRIGHTNESS = 0.06  # of Cycles' sky, where the model says kcd/m^2
LOWEST = 1e-3      # cosine to the zenith of the horizon
# Of Perez' five coefficients: factors of turbidity, and what is added; for luminance Y and chromaticities x, y.
PEREZ = np.array([[(0.1787, -1.4630), (-0.3554, 0.4275), (-0.0227, 5.3251), (0.1206, -2.5771), (-0.0670, 0.3703)],
                  [(-0.0193, -0.2592), (-0.0665, 0.0008), (-0.0004, 0.2125), (-0.0641, -0.8989), (-0.0033, 0.0452)],
                  [(-0.0167, -0.2608), (-0.0950, 0.0092), (-0.0079, 0.2102), (-0.0441, -1.6537), (-0.0109, 0.0529)]])
# Of x and y of the zenith: factors of turbidity squared, itself and 1, by the sun's angle cubed, squared, itself and 1.
ZENITH = np.array([[(0.00166, -0.00375, 0.00209, 0), (-0.02903, 0.06377, -0.03202, 0.00394),
                    (0.11693, -0.21196, 0.06052, 0.25886)],
                   [(0.00275, -0.00610, 0.00317, 0), (-0.04214, 0.08970, -0.04153, 0.00516),
                    (0.15346, -0.26756, 0.06670, 0.26688)]])


def preetham_sky(direction: np.ndarray, sun: np.ndarray, turbidity: float) -> np.ndarray:
    """(..., 3) linear Rec.709 from unit vectors (..., 3); sun: (3,) unit. Below the horizon it is as there."""
    from_zenith = float(np.arccos(np.clip(sun[2], 0, 1)))
    coefficients = PEREZ @ (turbidity, 1)
    up, cosine = direction[..., 2:].clip(LOWEST, 1), (direction @ sun)[..., None].clip(-1, 1)
    shape = _perez(coefficients, up, cosine) / _perez(coefficients, 1.0, np.cos(from_zenith))
    chi = (4 / 9 - turbidity / 120) * (np.pi - 2 * from_zenith)
    luminance = (4.0453 * turbidity - 4.9710) * np.tan(chi) - 0.2155 * turbidity + 2.4192
    x, y = ZENITH @ from_zenith ** np.arange(3, -1, -1) @ (turbidity ** 2, turbidity, 1)
    luminance, x, y = np.moveaxis(shape * (BRIGHTNESS * luminance, x, y), -1, 0)
    xyz = np.stack([x / y * luminance, luminance, (1 - x - y) / y * luminance], -1)
    return (xyz @ XYZ_TO_REC709.T).clip(0)


def _perez(coefficients: np.ndarray, up: np.ndarray | float, cosine: np.ndarray | float) -> np.ndarray:
    """(..., 3) of Y, x, y, at cosines (..., 1) to the zenith and to the sun."""
    a, b, c, d, e = coefficients.T
    return (1 + a * np.exp(b / up)) * (1 + c * np.exp(d * np.arccos(cosine)) + e * np.square(cosine))
