# SPDX-License-Identifier: GPL-3.0-or-later
"""Light that a hair sends back, and through, by what it is made of (Marschner 2003, d'Eon 2011, Chiang 2016)."""
from __future__ import annotations

import numpy as np

EUMELANIN, PHEOMELANIN = np.float32([0.506, 0.841, 1.653]), np.float32([0.343, 0.733, 1.924])  # absorption per radius
MOST_MELANIN = 1 - 1e-4
DARKEST = 1e-5  # a colour of 0 would absorb without end
OFFSETS = ((np.arange(32) + 0.5) / 32)[:, None]  # of rays from the axis of the fibre, in radii
ONWARD = 0.6    # of the light that goes through, what goes on as if there were no fibre; measured in pictures of Cycles


def absorption_of_color(color, radial_roughness) -> np.ndarray:
    """Absorption (..., 3) per radius of a fibre in hair that as a whole looks like `color` (Chiang 2016, 4.2)."""
    b = np.clip(radial_roughness, 0, 1)
    slope = 5.969 + b * (-0.215 + b * (2.532 + b * (-10.73 + b * (5.574 + b * 0.245))))
    return (np.log(np.clip(color, DARKEST, 1)) / slope) ** 2


def absorption_of_melanin(melanin, redness) -> np.ndarray:
    """Absorption (..., 3) per radius by the share of melanin, 0 to 1, and that of pheomelanin in it."""
    amount, redness = -np.log(1 - np.clip(melanin, 0, MOST_MELANIN)), np.clip(redness, 0, 1)
    return amount * ((1 - redness) * EUMELANIN + redness * PHEOMELANIN)


def albedo(absorption, ior) -> tuple[np.ndarray, np.ndarray]:
    """Shares of the light (..., 3) that a fibre, lit from the side, scatters back (R, TRT and later lobes) and on (TT).

    Light that goes straight on counts as not scattered (similarity theory). absorption: (..., 3) per radius; ior:
    (..., 1).
    """
    ior = np.maximum(np.asarray(ior), 1.0001)[..., None]  # (..., 1, 1): colours behind offsets
    outside, inside = np.sqrt(1 - OFFSETS ** 2), np.sqrt(1 - (OFFSETS / ior) ** 2)
    perpendicular = ((outside - ior * inside) / (outside + ior * inside)) ** 2
    parallel = ((ior * outside - inside) / (ior * outside + inside)) ** 2
    fresnel = (perpendicular + parallel) / 2
    crossed = np.exp(-2 * inside * np.asarray(absorption)[..., None, :])
    through = (1 - fresnel) ** 2 * crossed
    back = fresnel + through * fresnel * crossed / (1 - fresnel * crossed)
    back, through = back.mean(axis=-2), through.mean(axis=-2)
    scattered = 1 - ONWARD * through
    return (back / scattered).astype(np.float32), ((1 - ONWARD) * through / scattered).astype(np.float32)
