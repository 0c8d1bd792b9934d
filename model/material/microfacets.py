# SPDX-License-Identifier: GPL-3.0-or-later
"""Rough dielectrics as GGX facets (Walter et al. 2007, "Microfacet models for refraction through rough surfaces")."""
from __future__ import annotations

import numpy as np

from ..geometry import unit


def fresnel(cosine: np.ndarray, ior: np.ndarray) -> np.ndarray:
    """(N,) share of unpolarised light that a dielectric mirrors at cosines (N,); ior: behind it over before it."""
    cosine = cosine.clip(0, 1)
    g2 = ior**2 - 1 + cosine**2
    g = np.sqrt(g2.clip(0))
    across, along = (g - cosine) / (g + cosine).clip(1e-9), (cosine * (g + cosine) - 1) / (cosine * (g - cosine) + 1)
    return np.where(g2 > 0, across**2 / 2 * (1 + along**2), 1)


def visible_facets(normal: np.ndarray, ray: np.ndarray, alpha: np.ndarray, chance: np.ndarray) -> np.ndarray:
    """(N, 3) f32 unit normals of the facets that unit rays (N, 3) meet on surfaces, as often as they meet these.

    normal: (N, 3), unit, facing the rays; alpha: (N,), of GGX; chance: (N, 2) in [0, 1).
    Dupuy and Benyoub 2023, "Sampling visible GGX normals with spherical caps".
    """
    aside = unit(np.cross(normal, np.where(np.abs(normal[:, :1]) < 0.7, [[1, 0, 0]], [[0, 1, 0]])))
    axes = np.stack([aside, np.cross(normal, aside), normal], axis=1)
    stretch = np.stack([alpha, alpha, np.ones_like(alpha)], axis=1)
    seen = unit(stretch * -np.einsum("nkc,nc->nk", axes, ray))
    z = (1 - chance[:, 0]) * (1 + seen[:, 2]) - seen[:, 2]
    sine, phi = np.sqrt((1 - z**2).clip(0)), 2 * np.pi * chance[:, 1]
    facet = unit(stretch * (seen + np.stack([sine * np.cos(phi), sine * np.sin(phi), z], axis=1)))
    return np.einsum("nkc,nk->nc", axes, facet).astype(np.float32)


def unmasked(before: np.ndarray, behind: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """(N,) share of the light from visible facets that no other facet is in the way of.

    before, behind: (N,) cosines of the ways to and from the surface with its normal.
    """
    first, second = ((np.sqrt(1 + alpha**2 * (1 / (c**2).clip(1e-9, 1) - 1)) - 1) / 2 for c in (before, behind))
    return (1 + first) / (1 + first + second)
