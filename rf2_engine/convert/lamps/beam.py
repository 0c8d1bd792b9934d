# SPDX-License-Identifier: GPL-3.0-or-later
"""Beams of lamps as cosines (outer, inner) between which radiance rises smoothly (model/scene.py, `beam_cosine`)."""
from __future__ import annotations

import math

import numpy as np

EDGE = 1e-3                         # least width, in cosines, of a beam's border
HALF_SPACE = (0.0, EDGE)            # everything in front of a flat lamp


def spread_beam(spread: float) -> tuple[float, tuple[float, float]]:
    """Gain on the radiance and beam cosines (outer, inner) that come nearest to an area lamp's spread angle.

    Cycles lets radiance fall linearly in the tangent, (tan H - tan a) / (tan H - H) with H half the spread. The beam
    here is smooth in the cosine: it keeps the flux, `inner` is the least-squares fit (above 1 for a peaked beam).
    """
    half = min(spread / 2, math.pi / 2 - 1e-3)
    if spread > math.pi - 0.01:
        return 1.0, HALF_SPACE
    angle = np.linspace(0, half, 200)
    flux = np.cos(angle) * np.sin(angle) / len(angle)
    exact = (math.tan(half) - np.tan(angle)) / max(math.tan(half) - half, 1e-12)
    outer = math.cos(half)
    inner = (outer + (1 - outer) * np.linspace(0.05, 1.5, 150))[:, None]
    t = np.clip((np.cos(angle) - outer) / (inner - outer), 0, 1)
    beam = t * t * (3 - 2 * t)
    gain = (exact * flux).sum() / (beam * flux).sum(axis=1, keepdims=True)
    best = int(((gain * beam - exact) ** 2 * flux).sum(axis=1).argmin())
    return float(gain[best, 0]), (outer, float(inner[best, 0]))


def spot_beam(light, stretch: float) -> tuple[float, float]:
    """Cosines of a spot, `stretch` times as wide in the tangent as its angle says because its object is scaled.

    Cycles lets intensity rise with a smoothstep in the cosine from the border of the cone over `blend` of the way.
    """
    outer = math.cos(light.spot_size / 2)
    inner = outer + (1 - outer) * light.spot_blend
    angles = (math.acos(outer), math.acos(min(inner, 1)))
    outer, inner = (math.cos(math.atan2(stretch * math.sin(a), math.cos(a))) for a in angles)
    return outer, max(inner, outer + min(EDGE, (1 - outer) / 2))
