# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays against triangles, by Embree (Wald et al. 2014, "Embree"). See `Rays`.

All visibility in this project is computed here. If Embree cannot be imported, another caster with the same two
functions takes its place (`Rays.fallback`), such as Blender's own BVH.
"""
from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from .compute.threads import Once, spread

CHUNK = 1 << 16  # rays between two progress reports: about 0.02 s


class Hits(NamedTuple):
    """The first hits of P rays."""

    triangle: np.ndarray  # (P,) i32, -1 = nothing
    distance: np.ndarray  # (P,) f32 in lengths of the direction, infinite = nothing
    weights: np.ndarray   # (P, 2) f32 of the triangle's corners 0 and 1


class Caster(Protocol):
    """Rays against the triangles (T, 3, 3) f32 that it was made from, T > 0; arrays are contiguous f32."""

    def closest(self, origin: np.ndarray, direction: np.ndarray) -> Hits: ...

    def blocked(self, origin: np.ndarray, direction: np.ndarray, distance: np.ndarray) -> np.ndarray: ...


class Rays:
    """Rays against triangles (T, 3, 3), in the units and the frame of the triangles.

    Triangles have no front: rays hit them from both sides. A ray that starts on a triangle may hit it. The first rays
    build the tree: a scene has more kinds of surfaces than every picture asks for.
    """

    fallback: Callable[[np.ndarray], Caster] | None = None  # makes the caster of triangles where Embree is absent

    def __init__(self, triangles: np.ndarray):
        self._triangles, self._is_empty, self._made = triangles, not len(triangles), Once()

    def closest(self, origin: np.ndarray, direction: np.ndarray) -> Hits:
        """The first hits from points (P, 3), or from one point, along directions (P, 3)."""
        if self._is_empty or not len(direction):
            count = len(direction)
            return Hits(np.full(count, -1, np.int32), np.full(count, np.inf, np.float32),
                        np.zeros((count, 2), np.float32))
        return Hits(*map(np.concatenate, zip(*spread(self._caster().closest, _chunks(origin, direction)), strict=True)))

    def blocked(self, origin: np.ndarray, direction: np.ndarray,
                distance: np.ndarray | float = np.inf) -> np.ndarray:
        """(P,) bool: whether anything is hit within a distance (P,), in lengths of the directions."""
        if self._is_empty or not len(direction):
            return np.zeros(len(direction), bool)
        return np.concatenate(spread(self._caster().blocked, _chunks(origin, direction, distance)))

    def _caster(self) -> Caster:
        def make() -> Caster:
            caster, self._triangles = _make_caster(np.ascontiguousarray(self._triangles, np.float32)), None
            return caster

        return self._made.get(make)


class EmbreeCaster:
    def __init__(self, triangles: np.ndarray):
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene
        self._scene = EmbreeScene()
        self._triangles = TriangleMesh(self._scene, triangles)
        self.closest(*np.zeros((2, 1, 3), np.float32))  # builds its tree, which several threads must not do at once

    def closest(self, origin: np.ndarray, direction: np.ndarray) -> Hits:
        hits = self._scene.run(origin, direction, query="INTERSECT", output=True)
        missed = hits["primID"] < 0
        weights = np.stack([1 - hits["u"] - hits["v"], hits["u"]], axis=1)
        weights[missed] = 0
        return Hits(hits["primID"], np.where(missed, np.float32(np.inf), hits["tfar"]), weights)

    def blocked(self, origin: np.ndarray, direction: np.ndarray, distance: np.ndarray) -> np.ndarray:
        return self._scene.run(origin, direction, dists=distance.clip(0), query="OCCLUDED") >= 0  # negative: all are


def has_embree() -> bool:
    """Not remembered: the package may be installed meanwhile, and Python itself remembers what it has imported."""
    try:
        import embreex.mesh_construction  # noqa: F401
        import embreex.rtcore_scene  # noqa: F401
    except (ImportError, OSError):  # a library of the package's own that does not load, too
        return False
    return True


def _make_caster(triangles: np.ndarray) -> Caster:
    if has_embree():
        return EmbreeCaster(triangles)
    if Rays.fallback is None:
        raise ModuleNotFoundError("the Python package embreex is missing: pip install embreex")
    return Rays.fallback(triangles)


def _chunks(*arrays: np.ndarray | float) -> list[tuple[np.ndarray, ...]]:
    """Rows of arrays that broadcast against the second, CHUNK at a time, as the casters want them."""
    direction = arrays[1]
    shapes = [direction.shape if i < 2 else direction.shape[:1] for i in range(len(arrays))]
    full = [np.broadcast_to(np.asarray(a, np.float32), shape) for a, shape in zip(arrays, shapes, strict=True)]
    return [tuple(np.require(a[first:first + CHUNK], requirements="CW") for a in full)
            for first in range(0, len(direction), CHUNK)]
