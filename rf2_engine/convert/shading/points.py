# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a node graph is evaluated: on the texels of tiles, at the pixels of a picture, in a direction, at a lamp."""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ....model.scene import barycentric_grid
from ....model.surface_kinds import Ray
from ..data.arrays import unit
from ..data.copied import Instance
from ..data.mesh import TriangleMesh, face_normals
from .lamp_nodes import LampPoints


@dataclass
class Points:
    """Surfaces fill most of it, the world `direction` alone, lamps `lamp` alone.

    On surfaces there are r x c points on every one of m triangles: the 32 x 32 texels of tiles, or those of a much
    smaller tile around a pixel.
    """

    uv: Mapping[str, np.ndarray] = field(default_factory=dict)   # (m, r, c, 3) f32 per UV layer
    active_uv: str | None = None
    attributes: Mapping[str, np.ndarray] = field(default_factory=dict)  # (m, r, c, channels) f32 by name
    active_color: str | None = None
    corners: np.ndarray | None = None                            # (m, 3, 3) f32, in the frame of the object
    texture_space: np.ndarray | None = None                      # (2, 3) f32 (data/mesh.py)
    normals: np.ndarray | None = None                            # (m, 3, 3) f32, in the same frame
    instance: Instance = field(default_factory=Instance)
    direction: np.ndarray | None = None                          # (..., 3) f32, unit, away from the scene
    lamp: LampPoints | None = None
    is_displaced: bool = False                                   # displacement is in the corners already
    ray: Ray = Ray.DIFFUSE                                       # of which Light Path tells
    is_behind: bool = False                                      # whether it meets the backs of faces
    weights: np.ndarray | None = None                            # (m, r, c, 3) f32 of corners; None: texels of tiles
    first_alone: bool = False                                    # the other points only give the first one's footprint

    @cached_property
    def position(self) -> np.ndarray:
        """(m, r, c, 3) f32 in the frame of the object."""
        return interpolate(self.corners, self.weights)

    @cached_property
    def normal(self) -> np.ndarray:
        """(m, r, c, 3) f32, unit."""
        return unit(interpolate(self.normals, self.weights))

    @property
    def face_normal(self) -> np.ndarray:
        """(m, 1, 1, 3) f32, unit."""
        return face_normals(self.corners).astype(np.float32)[:, None, None]

    def grid(self, name: str) -> np.ndarray | None:
        """Values (..., c) of a grid of numbers; None where there are no grids."""

    @property
    def edges(self) -> np.ndarray:
        """(m, 2, 3) f32 ways along a row and a column of the tile, from its first texel on."""
        return self.corners[:, :2] - self.corners[:, 2:] if self.weights is None else self.ways(self.corners)

    def ways(self, corners: np.ndarray) -> np.ndarray:
        """(m, 2, c) f32 by how much corner values (m, 3, c) change along a row and a column of points with weights."""
        first, size = self.weights[:, 0, 0], self.weights.shape[1]
        steps = np.stack([self.weights[:, 0, -1] - first, self.weights[:, -1, 0] - first], axis=1)
        return steps * np.float32(size / (size - 1)) @ corners

    def widths(self, values: np.ndarray) -> np.ndarray | None:
        """(m, 1, 1, c) how far values (..., c) go over a pixel; None where points are no pixels or have no neighbours.
        """
        if self.weights is None or values.ndim != 4 or values.shape[1:3] == (1, 1):
            return None
        first = values[:, :1, :1]
        return np.abs(values[:, :1, -1:] - first) + np.abs(values[:, -1:, :1] - first)

    def uv_edges(self, name: str = "") -> np.ndarray | None:
        """(m, 2, 2) f32, the same as `edges` in a UV layer, the active one when empty; None where there is none."""
        layer = self.uv.get(name or self.active_uv)
        if layer is None:
            return None
        last = layer.shape[1] - 1
        edges = np.stack([layer[:, 0, last] - layer[:, 0, 0], layer[:, last, 0] - layer[:, 0, 0]], axis=1)
        return edges[..., :2] * np.float32(layer.shape[1] / last)

    @property
    def generated(self) -> np.ndarray:
        """(m, r, c, 3) f32, 0 to 1 across the mesh's texture space."""
        middle, half = self.texture_space
        return (self.position - middle) * np.divide(0.5, half, out=np.zeros(3, np.float32), where=half != 0) + 0.5


class Layers(Mapping):
    """Layers of a mesh (n, 3, c) at points, interpolated when they are first read."""

    def __init__(self, layers: Mapping[str, np.ndarray], rows=slice(None), weights: np.ndarray | None = None):
        """rows: of the triangles; weights: as of Points."""
        self._layers, self._rows, self._weights, self._values = layers, rows, weights, {}

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self._values:
            self._values[name] = interpolate(self._layers[name][self._rows], self._weights)
        return self._values[name]

    def __iter__(self):
        return iter(self._layers)

    def __len__(self) -> int:
        return len(self._layers)


class UvLayers(Layers):
    """UV layers as coordinates in space."""

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self._values:
            self._values[name] = np.pad(super().__getitem__(name), ((0, 0), (0, 0), (0, 0), (0, 1)))
        return self._values[name]


def surface_points(mesh: TriangleMesh, instance: Instance, rows=slice(None), weights: np.ndarray | None = None,
                   first_alone: bool = False, ray: Ray = Ray.DIFFUSE,
                   is_behind: bool = False) -> Points:
    """Points on some triangles of a mesh, as a ray meets them: the texels of their tiles without `weights`."""
    return Points(UvLayers(mesh.uv, rows, weights), mesh.active_uv, Layers(mesh.attributes, rows, weights),
                  mesh.active_color, mesh.corners[rows], mesh.texture_space, mesh.normals[rows], instance,
                  is_displaced=mesh.is_displaced, ray=ray, is_behind=is_behind, weights=weights,
                  first_alone=first_alone)


def interpolate(corners: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
    """(m, 3, c) corner values -> (m, r, c, c) at points with these weights (m, r, c, 3), or on the tile grid,
    extrapolated beyond the hypotenuse."""
    if weights is None:
        return np.einsum("rck,mkd->mrcd", barycentric_grid(), corners, optimize=True).astype(np.float32)
    return np.einsum("mrck,mkd->mrcd", weights, corners)
