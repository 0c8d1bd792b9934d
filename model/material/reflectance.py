# SPDX-License-Identifier: GPL-3.0-or-later
"""How much light a dielectric reflects: smooth, rough, and as GGX facets (docs/scene-input.md 3.2; Walter et al. 2007,
"Microfacet models for refraction through rough surfaces").
"""
from __future__ import annotations

import numpy as np

from ..geometry import unit

SMOOTH = 4.08567, 1.00071  # of the mean reflectance of a smooth dielectric (Kulla and Conty 2017)
ROUGH = 0.78, 1.2          # how much less a rough one reflects: fitted to Cycles' Glossy Color
BLURRED = 0.45             # GGX alpha at least behind a diffuse bounce: what Filter Glossy 1 makes of it in the mean


def normal_reflectance(ior: np.ndarray) -> np.ndarray:
    """Share of the light at normal incidence that a layer of a tile's index, which stands for level 1, reflects."""
    return 2 * ((ior - 1) / (ior + 1)) ** 2


def blurred(roughness: np.ndarray) -> np.ndarray:
    """Perceptual roughness, as it is where Cycles sees a surface from a matte one."""
    return np.maximum(roughness, BLURRED ** 0.5)


def layer_reflectance(ior: np.ndarray, roughness: np.ndarray) -> np.ndarray:
    """The same of light from everywhere; roughness is perceptual, 0 to 1."""
    amplitude = np.sqrt(normal_reflectance(np.maximum(ior, 1)))
    index = (1 + amplitude) / np.maximum(1 - amplitude, 1e-3)
    return (index - 1) / (SMOOTH[0] + SMOOTH[1] * index) * (1 - ROUGH[0] * roughness ** ROUGH[1])


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
