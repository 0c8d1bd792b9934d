# SPDX-License-Identifier: GPL-3.0-or-later
"""Guides whose materials are those at the pixel, not of a texel of the token's tile, where these can be asked for."""
from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from ..geometry import area_vectors, barycentric, corner_weights, dot, unit
from ..scene import PARAMETERS, Guides, RenderScene, View, texels
from .from_rays import OF_ALL, colors_of_texels

FOOTPRINT = 0.7   # pixels that a material is asked to blur over, about the width of a filter
GRAZING = 0.02    # cosine at which that is no longer stretched
EVEN = 0.02       # difference from the neighbours up to which all samples of a pixel have the colours of the first
COLORS = tuple(name for name in OF_ALL if name not in ("environment", "alpha"))


class Appearance(NamedTuple):
    """What is seen at P points."""

    is_known: np.ndarray  # (P,) bool; the rest is arbitrary elsewhere
    texel: np.ndarray     # (P, 7) f32, channels of TILE before the normal
    emission: np.ndarray  # (P, 3) f32, radiance
    normal: np.ndarray    # (P, 3) f32, unit, world

    @classmethod
    def empty(cls, normal: np.ndarray) -> Appearance:
        """Of points with these normals (P, 3), of which nothing else is known."""
        return cls(np.zeros(len(normal), bool), np.zeros((len(normal), PARAMETERS.stop), np.float32),
                   np.zeros_like(normal), normal.copy())


class Materials(Protocol):
    """Who can say what is seen at a point of the geometry of a scene."""

    def groups(self, triangle: np.ndarray) -> np.ndarray:
        """(P,) i32 number of the material of triangles (P,), -1 where the token's tile is exact, and for triangle -1.
        """

    def at(self, triangle: np.ndarray, weights: np.ndarray, steps: np.ndarray, normal: np.ndarray) -> Appearance:
        """What is seen at points of triangles (P,) that belong to groups.

        weights: (P, 3) f32 of their corners. steps: (P, 2, 3) f32, by how much these change along a row and a column
        of the picture over what is to be blurred. normal: (P, 3) unit shading normals, world, facing the camera.
        """


class MaterialsAtPixels:
    """Adds to guides of a view of a scene, sample by sample of its pixels, what materials are like there."""

    def __init__(self, scene: RenderScene, view: View, materials: Materials):
        self._scene, self._view, self._materials = scene, view, materials
        self._first: tuple[np.ndarray, Guides, np.ndarray] | None = None  # groups, guides, and which pixels are even

    def add(self, guides: Guides, rays: np.ndarray, triangle: np.ndarray, weights: np.ndarray) -> Guides:
        """The result of `guides_of_hits` for these arguments, with materials at the pixels; it is changed.

        Where a pixel looks like its neighbours, further samples take over what the first one has found.
        """
        group = self._materials.groups(triangle.ravel())
        at = np.flatnonzero(group >= 0)
        if len(at) if self._first is None else self._first[1].material is not None:
            guides.material = self._of_tokens(guides)
        if self._first is not None:
            first_group, first, is_even = self._first
            is_known = is_even[at] & (first_group[at] == group[at])
            known, at = at[is_known], at[~is_known]
            for name in COLORS:
                _pixels(guides, name)[known] = _pixels(first, name)[known]
        if len(at):
            self._evaluate(guides, rays, triangle.ravel()[at], corner_weights(weights.reshape(-1, 2)[at]), at)
        if self._first is None:
            self._first = group, guides, _is_even(guides, group.reshape(triangle.shape)).ravel()
        return guides

    def _of_tokens(self, guides: Guides) -> np.ndarray:
        """(H, W, 7) f16 of the tiles."""
        if not len(self._scene):
            return np.zeros((*guides.depth.shape, PARAMETERS.stop), np.float16)
        x, y = texels(guides.hit_barycentric)
        return self._scene.tiles[self._scene.tile_index[guides.hit_triangle.clip(0)], PARAMETERS, y, x]

    def _evaluate(self, guides: Guides, rays: np.ndarray, triangle: np.ndarray, weights: np.ndarray,
                  at: np.ndarray) -> None:
        """Write what is seen at pixels by number (P,)."""
        ray, offset = rays.reshape(-1, 3)[at], _pixels(guides, "position")[at] - self._view.camera_to_world[:3, 3]
        steps = _steps(self._scene.surfaces.triangles[triangle], ray, dot(offset, ray), _turns(rays, at))
        seen = self._materials.at(triangle, weights, steps, _pixels(guides, "normal")[at])
        at, ray, texel, normal = (values[seen.is_known] for values in (at, ray, seen.texel, seen.normal))
        for name, values in zip(COLORS, (*colors_of_texels(texel), seen.emission[seen.is_known]), strict=True):
            _pixels(guides, name)[at] = values
        if guides.material is not None:
            _pixels(guides, "material")[at] = texel
        behind = (dot(normal, ray) + GRAZING).clip(0)  # a bent normal may point away from the camera
        _pixels(guides, "normal")[at] = unit(normal - behind[:, None] * ray)


def _turns(rays: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(P, 2, 3) by how much rays (H, W, 3) differ along the row and the column at pixels by number (P,)."""
    height, width = rays.shape[:2]
    row, column = np.divmod(at, width)
    below, right = (row + 1).clip(max=height - 1), (column + 1).clip(max=width - 1)
    return np.stack([rays[row, right] - rays[row, (right - 1).clip(0)],
                     rays[below, column] - rays[(below - 1).clip(0), column]], axis=1)


def _steps(corners: np.ndarray, ray: np.ndarray, distance: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """(P, 2, 3) f32 steps of weights on triangles (P, 3, 3), as `Materials.at` has them.

    They are hit along ray (P, 3) at a distance (P,); turns (P, 2, 3): of the ray to the next pixels (Igehy 1999,
    "Tracing Ray Differentials").
    """
    normal = unit(area_vectors(corners))
    cosine = dot(ray, normal)
    cosine = np.where(cosine < 0, -1, 1) * np.abs(cosine).clip(GRAZING)
    along = (dot(turns, normal[:, None]) / cosine[:, None])[..., None] * ray[:, None]
    ways = (FOOTPRINT * distance)[:, None, None] * (turns - along)
    last = corners[:, None, 2].astype(np.float64)
    return (barycentric(corners[:, None], last + ways) - (0, 0, 1)).astype(np.float32)


def _is_even(guides: Guides, group: np.ndarray) -> np.ndarray:
    """(H, W) bool: pixels whose four neighbours show the same group (H, W) in about the same colours."""
    even = np.ones(group.shape, bool)
    for axis in (0, 1):
        same = np.diff(group, axis=axis) == 0
        for name in COLORS:
            same &= np.abs(np.diff(np.sqrt(getattr(guides, name)), axis=axis)).max(axis=-1) < EVEN
        edge = ((0, 0),) * axis
        even &= np.pad(same, (*edge, (1, 0), *((0, 0),) * (1 - axis)), constant_values=True)
        even &= np.pad(same, (*edge, (0, 1), *((0, 0),) * (1 - axis)), constant_values=True)
    return even


def _pixels(guides: Guides, name: str) -> np.ndarray:
    """(H W, ...) the same memory."""
    values = getattr(guides, name)
    return values.reshape(-1, *values.shape[2:])
