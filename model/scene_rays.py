# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays against the real surfaces of a scene, in any frame; all callers share a tree for each kind of surface.

Surfaces that some rays do not meet have trees of their own.
"""
from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .progress import part
from .rays import Hits, Rays
from .scene import ALL_GROUPS, RenderScene
from .surface_kinds import Kind, Ray, is_kind, token_kinds

NAME = "scene_rays"  # under which a scene keeps its own
MOST_EDITED = 0.3    # of the triangles of a kind, that have a tree of their own

Tree = tuple[np.ndarray, Rays]  # rows of triangles, i32, and rays against them


class TreeCache:
    """Trees of the surfaces of a scene that is edited again and again.

    Triangles that have changed since the first version get a tree of their own, so while an object of a large scene is
    dragged only that one's tree is built again.
    """

    def __init__(self) -> None:
        self._versions: dict[tuple, tuple[np.ndarray, np.ndarray, list[Tree]]] = {}

    def of(self, kind: tuple, triangles: np.ndarray) -> list[Tree]:
        """Trees of the triangles (K, 3, 3) of one kind, by their rows."""
        before, was_edited, trees = self._versions.get(kind, (triangles[:0], np.zeros(0, bool), []))
        if before.shape == triangles.shape:
            changed = (before != triangles).any(axis=(1, 2))
            is_edited = was_edited | changed
        if before.shape != triangles.shape or np.count_nonzero(is_edited) > MOST_EDITED * len(triangles):
            changed, is_edited = np.ones(len(triangles), bool), np.zeros(len(triangles), bool)
        groups = np.flatnonzero(~is_edited), np.flatnonzero(is_edited)
        trees = [next((tree for tree in trees if np.array_equal(tree[0], rows) and not changed[rows].any()), None)
                 or (rows, Rays(triangles[rows])) for rows in groups]
        self._versions[kind] = triangles, is_edited, trees
        return trees


class KindTrees:
    """Rays against the triangles of each kind in a scene, made when first needed."""

    def __init__(self, scene: RenderScene, cache: TreeCache | None = None):
        self._scene, self._cache = scene, cache
        # Subtracted from all points: the precision of rays depends on it.
        self.center = np.zeros(3, np.float32) if scene.box is None else scene.box.mean(axis=0)
        self._trees: dict[tuple[Kind, int, int], list[Tree]] = {}

    @cached_property
    def kinds(self) -> np.ndarray:
        """(G,) i32, the Kind of each triangle of the geometry."""
        return token_kinds(self._scene)[self._scene.surfaces.token]

    @cached_property
    def hidden(self) -> np.ndarray:
        """(G,) u8, the kinds of rays that do not meet it."""
        return self._scene.hidden_from[self._scene.surfaces.token]

    @cached_property
    def hidings(self) -> list[int]:
        """All that `hidden` holds."""
        return np.unique(self._scene.hidden_from).tolist() or [0]

    def of(self, kind: Kind, hiding: int, groups: int = ALL_GROUPS) -> list[Tree]:
        """Trees of the triangles of one kind that are hidden from such rays, of some groups of surfaces alone, by their
        rows in the geometry, -1 behind these for no hit."""
        key = kind, hiding, groups
        if key not in self._trees:
            is_own = is_kind(self.kinds, kind) & (self.hidden == hiding)
            if groups != ALL_GROUPS:
                group = self._scene.seldom("group")[self._scene.surfaces.token]
                is_own &= (np.uint64(groups) >> group.astype(np.uint64)) & np.uint64(1) > 0
            rows = np.flatnonzero(is_own)
            triangles = self._scene.surfaces.triangles[rows] - self.center
            trees = ([(np.arange(len(rows)), Rays(triangles))] if self._cache is None
                     else self._cache.of(key, triangles))
            self._trees[key] = [(np.append(rows[own], -1).astype(np.int32), rays)
                                         for own, rays in trees if len(own)]
        return self._trees[key]


@dataclass(frozen=True)
class SceneRays:
    """Rays in the frame of a scene; hits are rows of its geometry (`RenderScene.surfaces`)."""

    trees: KindTrees
    offset: np.ndarray  # (3,) f32, subtracted from points of this frame, which are points of the trees
    factor: float       # when multiplied with this

    def moved(self, center: np.ndarray, scale: float) -> SceneRays:
        """The same trees for a frame in which points are (x - center) scale of those of this one."""
        return replace(self, offset=(self.offset - center) * np.float32(scale), factor=self.factor / scale)

    def rows(self, kinds: Kind, ray: Ray) -> np.ndarray:
        """(K,) rows of the triangles that are of these kinds, and that one of these rays meets."""
        return np.flatnonzero(is_kind(self.trees.kinds, kinds) & ~_is_hidden(self.trees.hidden, ray))

    def among(self, kinds: Kind, ray: Ray, groups: int = ALL_GROUPS) -> RaysAmong:
        """Rays that meet some kinds of surfaces alone, of those that are not hidden from them, and of some groups."""
        return RaysAmong(self, [tree for kind in kinds for hiding in self.trees.hidings if not _is_hidden(hiding, ray)
                                for tree in self.trees.of(kind, hiding, groups)])


@dataclass(frozen=True)
class RaysAmong:
    """Rays against some kinds of surfaces, with the functions of `Rays`."""

    rays: SceneRays
    trees: list[Tree]

    def closest(self, origin: np.ndarray, direction: np.ndarray) -> Hits:
        """The first hits from points (P, 3), or from one point, along directions (P, 3)."""
        origin, result = self._points(origin), None
        for i, (rows, rays) in enumerate(self.trees):
            with part(i / len(self.trees), (i + 1) / len(self.trees)):
                hits = rays.closest(origin, direction)
            hits = hits._replace(triangle=rows[hits.triangle])
            result = hits if result is None else _nearer(result, hits)
        if result is None:
            return Rays(np.zeros((0, 3, 3))).closest(origin, direction)
        return result._replace(distance=result.distance / np.float32(self.rays.factor))

    def blocked(self, origin: np.ndarray, direction: np.ndarray,
                distance: np.ndarray | float = np.inf) -> np.ndarray:
        """(P,) bool: whether anything is hit within a distance (P,), in lengths of the directions."""
        origin, distance = self._points(origin), np.multiply(distance, self.rays.factor, dtype=np.float32)
        blocked = np.zeros(len(direction), bool)
        for i, (_, rays) in enumerate(self.trees):
            with part(i / len(self.trees), (i + 1) / len(self.trees)):
                blocked |= rays.blocked(origin, direction, distance)
        return blocked

    def _points(self, points: np.ndarray) -> np.ndarray:
        if self.rays.factor == 1 and not self.rays.offset.any():
            return points
        return (points - self.rays.offset) * np.float32(self.rays.factor)


def scene_rays(scene: RenderScene, cache: TreeCache | None = None) -> SceneRays:
    """The rays of a scene, which keeps them: it must not change after the first call.

    cache: of earlier versions of the scene, at the first call.
    """
    if NAME not in vars(scene):
        trees = KindTrees(scene, cache)
        vars(scene)[NAME] = SceneRays(trees, trees.center, 1.0)
    return vars(scene)[NAME]


def share_rays(scene: RenderScene, moved: RenderScene, center: np.ndarray, scale: float) -> None:
    """Let a scene whose points are (x - center) scale of those of another use its trees."""
    vars(moved)[NAME] = scene_rays(scene).moved(center, scale)


def _is_hidden(hiding: np.ndarray | int, ray: Ray) -> np.ndarray | bool:
    return (hiding & int(ray)) == int(ray)


def _nearer(one: Hits, other: Hits) -> Hits:
    is_nearer = other.distance < one.distance
    return Hits(np.where(is_nearer, other.triangle, one.triangle), np.minimum(one.distance, other.distance),
                np.where(is_nearer[:, None], other.weights, one.weights))
