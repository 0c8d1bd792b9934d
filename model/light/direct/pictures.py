# SPDX-License-Identifier: GPL-3.0-or-later
"""Flat surfaces that shine unevenly, such as screens and signs: cut into a few emitters of their own colours."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...fields import Channels
from ...geometry import area_vectors, surfaces, unit
from ...scene import EMISSION_SIZE, RenderScene, barycentric_grid, cells_inside
from .outlines import convex_outline, cut, outline_vectors

CELLS = 32   # emitters that the pictures of a scene become, at most,
FEWEST = 4   # and each of them at least: no more pictures than that are cut, the brightest ones
UNEVEN = 8   # triangles of unequal radiance from which on a flat mesh is a picture
FINE = 128   # triangles of a picture, of more of which each shines evenly
# What a triangle shines with: radiance, beam (of length 0: none), and the number of its `Limits`.
LIGHT = Channels(1, radiance=3, beam_axis=3, beam_cosine=2, kind=1)
BUT_RADIANCE = slice(LIGHT["radiance"].stop, None)
GRID = barycentric_grid(EMISSION_SIZE)
INSIDE = cells_inside(EMISSION_SIZE)


@dataclass
class Picture:
    """A flat convex surface that shines, and S samples of what it shows."""

    rows: np.ndarray      # (n,) of the triangles that shine
    outline: np.ndarray   # (K, 3) corners around it
    position: np.ndarray  # (S, 3)
    flux: np.ndarray      # (S, 3), radiance times area
    area: np.ndarray      # (S,)

    def cells(self, count: int) -> list[tuple[np.ndarray, np.ndarray]]:
        """So many convex outlines (K, 3), and the radiance (3,) of each. Together they have the flux of the picture."""
        outlines = cut(self.outline, count)
        nearest = np.argmax([_depth(outline, self.position) for outline in outlines], axis=0)
        area = np.bincount(nearest, self.area, len(outlines))
        mean = self.flux.sum(axis=0) / self.area.sum()
        flux = np.stack([np.bincount(nearest, x, len(outlines)) for x in self.flux.T], axis=1)
        radiance = np.where(area[:, None] > 0, flux / np.where(area > 0, area, 1)[:, None], mean)
        sizes = np.linalg.norm([outline_vectors(outline) for outline in outlines], axis=1)
        radiance *= self.flux.sum(axis=0) / np.maximum(sizes @ radiance, 1e-30)
        return list(zip(outlines, radiance, strict=True))


def find_pictures(scene: RenderScene, light: np.ndarray, with_meshes: bool) -> list[Picture]:
    """Those among the triangles of a scene that shine, whose emission has tiles, or `with_meshes` is uneven over many.

    light: (L, len(LIGHT)) of these. Of bodies each face is one, and of what is not
    flat and convex each triangle.
    """
    rows = np.flatnonzero(scene.is_light)
    has_tile, corners = scene.seldom("emission_tile")[rows] >= 0, scene.triangles[rows]
    if not has_tile.any() and not with_meshes:
        return []
    facing = unit(area_vectors(corners)).round(3) + 0.0  # without negative zeros
    group, pictures = surfaces(corners, np.concatenate([light[:, BUT_RADIANCE], facing], axis=1)), []
    order = np.argsort(group, kind="stable")
    for own in np.split(order, np.flatnonzero(np.diff(group[order])) + 1):
        is_uneven = with_meshes and len(np.unique(light[own, LIGHT["radiance"]], axis=0)) > UNEVEN
        if not is_uneven and not has_tile[own].any():
            continue
        outline = convex_outline(corners[own])
        if outline is not None:
            pictures.append(_sampled(scene, rows, own, outline))
        else:
            pictures += [_sampled(scene, rows, own[[i]], corners[own[i]]) for i in np.flatnonzero(has_tile[own])]
    return sorted(pictures, key=lambda picture: -picture.flux.sum())[:CELLS // FEWEST]


def _sampled(scene: RenderScene, rows: np.ndarray, own: np.ndarray, outline: np.ndarray) -> Picture:
    """The picture of the triangles `own` (n,) of those in rows (L,) that shine. A sample is a texel, or a triangle."""
    rows = rows[own]
    corners = scene.triangles[rows].astype(np.float64)
    areas, samples = np.linalg.norm(area_vectors(corners), axis=1), []
    for triangle, row, area in zip(corners, rows, areas, strict=True):
        share, weights = np.ones((1, 3)), np.full((1, 3), 1 / 3)
        if len(rows) <= FINE and scene.emission_tile is not None and scene.emission_tile[row] >= 0:
            share = scene.emission_tiles[scene.emission_tile[row]][:, INSIDE].T.astype(np.float64)
            weights = GRID[INSIDE]
        size = np.full(len(share), area / len(share))
        samples.append((weights @ triangle, share * scene.emission[row] * size[:, None], size))
    return Picture(own, outline, *map(np.concatenate, zip(*samples, strict=True)))


def _depth(outline: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(S,) how far inside a flat convex outline (K, 3) points (S, 3) of its plane are, negative outside."""
    outline = outline.astype(np.float64)
    edges = np.roll(outline, -1, axis=0) - outline
    inward = np.cross(outline_vectors(outline), edges)
    inward /= np.linalg.norm(inward, axis=1, keepdims=True).clip(1e-30)
    return (points @ inward.T - np.einsum("kc,kc->k", outline, inward)).min(axis=1)
