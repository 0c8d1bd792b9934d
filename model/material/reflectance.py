# SPDX-License-Identifier: GPL-3.0-or-later
"""How much light a dielectric reflects: straight on, smooth, and as GGX facets (docs/scene-input.md 3.2; Walter et al.
2007, "Microfacet models for refraction through rough surfaces").
"""
from __future__ import annotations

from functools import cache

import numpy as np

from ..geometry import LEAST_IOR, unit

LAYERS = np.float64([0.0025, 0.01, 0.04, 0.09])  # f0 of dielectrics in tables: of IOR 1.1, 1.2, 1.5 and 1.9
LEAST_LAYER = 5e-3  # f0 from which on a layer reflects everything at grazing angles
TABLE, FACETS, LEAST_TABLED = (24, 32), 256, 0.05  # roughnesses and cosines, of each so many facets; least roughness
GOLDEN = (5 ** 0.5 - 1) / 2
BLURRED = 0.45  # least GGX alpha after a diffuse bounce: what Filter Glossy 1 leads to on average


def normal_reflectance(ior: np.ndarray) -> np.ndarray:
    """Share of the light at normal incidence that a layer reflects; ior: of a tile, at Specular IOR Level 1."""
    return 2 * ((ior - 1) / (ior + 1)) ** 2


def layer_reflectance(ior: np.ndarray, transmission: np.ndarray) -> np.ndarray:
    """The same of a tile that transmits so much: glass reflects by its IOR alone, half as much as Level 1 means."""
    return normal_reflectance(ior.clip(LEAST_IOR)) * (1 - transmission / 2)


def blurred(roughness):
    """Perceptual roughness as Cycles uses it for paths that have bounced off a diffuse surface; array or tensor."""
    return roughness.clip(BLURRED ** 0.5)


def widened(roughness, alpha2):
    """Perceptual roughness of a lobe as wide as two together, of this roughness and this squared GGX alpha, which add
    up; arrays or tensors, more than 1 where both are wide."""
    return (roughness ** 4 + alpha2) ** 0.25


def fresnel(cosine: np.ndarray, ior: np.ndarray) -> np.ndarray:
    """(N,) share of unpolarised light that a dielectric reflects at cosines (N,); ior: far side over near side."""
    cosine = cosine.clip(0, 1)
    g2 = ior**2 - 1 + cosine**2
    g = np.sqrt(g2.clip(0))
    across, along = (g - cosine) / (g + cosine).clip(1e-9), (cosine * (g + cosine) - 1) / (cosine * (g - cosine) + 1)
    return np.where(g2 > 0, across**2 / 2 * (1 + along**2), 1)


def visible_facets(normal: np.ndarray, ray: np.ndarray, alpha: np.ndarray, random: np.ndarray) -> np.ndarray:
    """(N, 3) f32 unit normals of the facets that unit rays (N, 3) hit, sampled by how visible they are.

    normal: (N, 3), unit, facing the rays; alpha: (N,), of GGX; random: (N, 2) in [0, 1).
    Dupuy and Benyoub 2023, "Sampling visible GGX normals with spherical caps".
    """
    aside = unit(np.cross(normal, np.where(np.abs(normal[:, :1]) < 0.7, [[1, 0, 0]], [[0, 1, 0]])))
    axes = np.stack([aside, np.cross(normal, aside), normal], axis=1)
    stretch = np.stack([alpha, alpha, np.ones_like(alpha)], axis=1)
    view = unit(stretch * -np.einsum("nkc,nc->nk", axes, ray))
    z = (1 - random[:, 0]) * (1 + view[:, 2]) - view[:, 2]
    sine, phi = np.sqrt((1 - z**2).clip(0)), 2 * np.pi * random[:, 1]
    facet = unit(stretch * (view + np.stack([sine * np.cos(phi), sine * np.sin(phi), z], axis=1)))
    return np.einsum("nkc,nk->nc", axes, facet).astype(np.float32)


def metal_share(base, white, single):
    """Share of its light that rough metal of a base color sends on although facets hide each other; arrays or tensors.

    white: what is left of light that has met one white facet. The rest meets more of them (Kulla and Conty 2017), but
    for a share `single` of the surface.
    """
    lost, base = 1 - white, base.clip(0, 1)  # a Glossy BSDF may have more
    return white + (1 - single) * lost * base * white / (1 - base * lost)


def slants(cosine: np.ndarray) -> list[np.ndarray]:
    """How far facets that light meets at cosines reflect as at grazing angles: of metals (Schlick 1994), of LAYERS."""
    iors = (1 + np.sqrt(LAYERS)) / (1 - np.sqrt(LAYERS))
    return [(1 - cosine).clip(0, 1) ** 5, *((fresnel(cosine, ior) - f0) / (1 - f0)
                                            for ior, f0 in zip(iors, LAYERS, strict=True))]


def split_sum(cosine: np.ndarray, roughness: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(N,) share of uniform light that white GGX facets reflect to a viewer at cosines (N,), and how much of it as
    `slants` of metals and (N, len(LAYERS)) of layers say (Karis 2013); roughness: (N,), perceptual."""
    table = split_sum_table()
    row, column = (x.clip(0, 1) * (size - 1) for x, size in zip((roughness, cosine), table.shape[1:], strict=True))
    top, left = (x.astype(int).clip(max=size - 2) for x, size in zip((row, column), table.shape[1:], strict=True))
    down, right = row - top, column - left
    upper, lower = ((1 - right) * table[:, i, left] + right * table[:, i, left + 1] for i in (top, top + 1))
    white, of_metal, *of_layers = np.float32((1 - down) * upper + down * lower)
    return white, of_metal, np.stack(of_layers, axis=1)


@cache
def split_sum_table() -> np.ndarray:
    """(2 + len(LAYERS), roughness, cosine) of these, from 0 to 1."""
    roughness, cosine = (x.ravel() for x in np.meshgrid(*(np.linspace(0, 1, n) for n in TABLE), indexing="ij"))
    alpha, cosine = roughness.clip(LEAST_TABLED).repeat(FACETS) ** 2, cosine.clip(0.01).repeat(FACETS)
    k = np.tile(np.arange(FACETS), len(roughness))
    viewer = np.stack([np.sqrt(1 - cosine ** 2), np.zeros_like(cosine), cosine], 1)
    normal = np.tile([0.0, 0.0, 1.0], (len(k), 1))
    facet = visible_facets(normal, -viewer, alpha, np.stack([(k + 0.5) / FACETS, k * GOLDEN % 1], 1))
    facing = np.einsum("nc,nc->n", facet, viewer)
    leaving = 2 * facing * facet[:, 2] - cosine
    weight = np.where(leaving > 0, unmasked(cosine, leaving, alpha), 0)
    means = np.stack([weight, *(weight * slant for slant in slants(facing))]).reshape(2 + len(LAYERS), -1, FACETS)
    return means.mean(2).reshape(-1, *TABLE)


def unmasked(before: np.ndarray, behind: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """(N,) share of the light from visible facets that no other facet blocks (Smith's masking and shadowing).

    before, behind: (N,) cosines between the normal and the directions to and from the surface.
    """
    first, second = ((np.sqrt(1 + alpha**2 * (1 / (c**2).clip(1e-9, 1) - 1)) - 1) / 2 for c in (before, behind))
    return (1 + first) / (1 + first + second)
