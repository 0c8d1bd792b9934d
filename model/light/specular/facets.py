# SPDX-License-Identifier: GPL-3.0-or-later
"""Facets of rough glass: a path meets one of them instead of the whole surface, so that neighbours share the lobe."""
from __future__ import annotations

import numpy as np

from ...geometry import dot, refracted
from ...material.reflectance import fresnel, visible_facets

LEAST_ROUGHNESS = 0.15  # below which glass shows an image
LATTICE = np.float32([[0.8567, 0.7339], [0.6287, 0.5386]])  # numbers of a column and of a row (R4 of Roberts 2018)


def pixel_starts(rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """(P, 2) f32 in [0, 1) of pixels (P,): those of neighbours fill each other's gaps."""
    return np.stack([columns, rows], 1).astype(np.float32) @ LATTICE.T % 1


def rough_facets(ray: np.ndarray, normal: np.ndarray, roughness: np.ndarray, start: np.ndarray,
                 number: int) -> np.ndarray:
    """(P, 3) f32 normals, those of rough glass of the facets that rays (P, 3) meet.

    normal: (P, 3), unit, facing the rays; roughness: (P,), perceptual; start: (P, 2) of `pixel_starts`; number: of the
    surface along the path, from 0.
    """
    is_rough, facets = roughness > LEAST_ROUGHNESS, normal.astype(np.float32)
    facets[is_rough] = visible_facets(*(x[is_rough] for x in (
        normal, ray, roughness ** 2, start * (2 * number + 1) % 1)))
    return facets


def exit_lobe(ray: np.ndarray, normal: np.ndarray, roughness: np.ndarray,
              ior: np.ndarray, least: float = LEAST_ROUGHNESS) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The lobe in which unit rays (P, 3) leave glass through a rough surface, as that of a mirror that is seen from the
    front: its axis (P, 3), its roughness (P,), and the share of light (P,) that gets out.

    normal: (P, 3), unit, facing the rays; roughness: (P,), perceptual; ior: (P,). There is none where steep rays stay
    inside, and where glass is smoother than `least` and shows an image.
    """
    axis = refracted(ray, normal, ior, np.ones(len(ray), bool))
    within, without = -dot(ray, normal), -dot(axis, normal)
    alpha2 = roughness ** 4
    turned = np.sqrt(alpha2 / (1 + alpha2))  # sine of the tilt of facets
    turn = np.arcsin(np.minimum(ior * turned, 1)) / np.arcsin(turned).clip(1e-4)
    turn = turn * within / without.clip(0.05) - 1  # of the ray for a turn of the facet; a mirror turns it by 2
    share = (1 - fresnel(within, 1 / ior)) / (1 + alpha2 * (ior ** 2 - 1))  # other facets are too steep
    share *= (without > 0) & (roughness > least)
    return axis, np.minimum(roughness * np.sqrt(turn.clip(0.1) / 2), 1), share
