# SPDX-License-Identifier: GPL-3.0-or-later
"""Unlit pictures of a copied scene, within a second or two: something to see until there is light.

Nothing is simplified or encoded: rays meet the meshes as they were copied, and materials are evaluated where they do.
"""
from __future__ import annotations

import numpy as np

from ...model import progress
from ...model.geometry import corner_weights, facing, interpolated, unit
from ...model.rays import Rays
from ...model.surface_kinds import Ray
from .data.blocks import Material
from .data.copied import CopiedMesh, CopiedScene, Instance
from .data.mesh import TriangleMesh
from .data.report import Report
from .meshes.sampling import keep_sample
from .shading.material import evaluate_material
from .shading.points import surface_points
from .shading.volume import has_surface

PIXELS = 1 << 16     # of a picture, at most, where somebody waits for it
MOST = 250_000       # triangles, whose tree takes half a second; of finer scenes a sample of each mesh, enlarged
LEAST = 12           # of a mesh
MORE = 1.4           # larger than what they stand for, so that there are few holes between those of a sample
CLEAR = 0.5          # share of light straight through a surface from which on rays go on
LAYERS = 4           # of clear surfaces, one behind the other
AMBIENT = 0.35       # of surfaces that are seen edge-on
BRIGHTNESS = 0.8
BRIGHTEST = 4.0      # radiance of what shines
BACKGROUND = 0.05    # where nothing is
STEP = 1e-4          # of the distance, by which a ray goes on behind what it has met


class Sketch:
    """The surfaces of a copied scene that cameras see, in the colours of their materials."""

    def __init__(self, copied: CopiedScene, before: Sketch | None = None) -> None:
        """before: an earlier one, whose tree holds where the same surfaces are at the same places."""
        self._items = [item for item in copied.objects if isinstance(item, tuple) and item[0].is_shown]
        self._shows = [tuple(map(has_surface, surface.slots)) for surface, _ in self._items]
        has_moved = before is None or before._places() != self._places()
        self._surfaces = _Surfaces(self._items, self._shows) if has_moved else before._surfaces

    @property
    def triangles(self) -> np.ndarray:
        """(n, 3, 3) f32 corners of what rays meet, world."""
        return self._surfaces.triangles

    def _places(self) -> list[tuple]:
        """Equal for the same surfaces at the same places."""
        return [(id(surface.real_mesh), shows, instance.matrix.tobytes())
                for (surface, instance), shows in zip(self._items, self._shows, strict=True)]

    def picture(self, origin: np.ndarray, rays: np.ndarray, transparent: bool) -> np.ndarray:
        """(H, W, 4) f32 premultiplied linear Rec.709 along unit rays (H, W, 3) from a point (3,), world.

        transparent: where nothing is, else dark grey.
        """
        shape, rays = rays.shape[:2], rays.reshape(-1, 3)
        picture = np.full((len(rays), 4), 0 if transparent else BACKGROUND, np.float32)
        picture[:, 3] = not transparent
        starts = np.broadcast_to(origin - self._surfaces.center, rays.shape).astype(np.float32)
        at = np.arange(len(rays))
        for layer in range(LAYERS):
            hits = self._surfaces.rays.closest(starts, rays[at])
            is_hit = hits.triangle >= 0
            at, starts = at[is_hit], starts[is_hit]
            if not len(at):
                break
            color, clear = self._colors(hits.triangle[is_hit], hits.weights[is_hit], rays[at])
            passes = (clear > CLEAR) & (layer < LAYERS - 1)
            picture[at[~passes]] = np.pad(color[~passes], ((0, 0), (0, 1)), constant_values=1)
            starts = (starts + (1 + STEP) * hits.distance[is_hit, None] * rays[at])[passes]
            at = at[passes]
        return picture.reshape(*shape, 4)

    def _colors(self, triangle: np.ndarray, weights: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(P, 3) as if lit by the camera, and (P,) the share of light that goes straight through."""
        item, row = self._surfaces.locate(triangle)
        share = corner_weights(weights).astype(np.float32)
        color, clear = np.zeros((len(triangle), 3), np.float32), np.zeros(len(triangle), np.float32)
        surfaces = {}
        for number in np.unique(item):  # instances of a mesh are evaluated together
            surfaces.setdefault(id(self._items[number][0]), []).append(number)
        for numbers in surfaces.values():
            surface, instance = self._items[numbers[0]]
            at = np.flatnonzero(np.isin(item, numbers))
            mesh = surface.real_mesh
            slot = surface.find_slots(mesh)[row[at]]
            for index in np.unique(slot):
                progress.report()
                own = at[slot == index]
                color[own], clear[own] = _evaluated(surface.slots[index], mesh, instance, row[own], share[own])
        shade = AMBIENT + (1 - AMBIENT) * np.abs((self._normals(item, row, share, triangle, rays) * rays).sum(1))
        return color * shade[:, None] * BRIGHTNESS, clear

    def _normals(self, item, row, share, triangle, rays) -> np.ndarray:
        """(P, 3) f32 unit, world."""
        normals = np.empty((len(row), 3), np.float32)
        for number in np.unique(item):
            own, (surface, instance) = item == number, self._items[number]
            smooth = interpolated(share[own], surface.real_mesh.normals[row[own]])
            normals[own] = smooth @ np.linalg.pinv(instance.matrix[:3, :3])
        return facing(unit(normals), rays)


class _Surfaces:
    """What rays meet of (surface, instance) items: all of their triangles, or a sample of each mesh."""

    def __init__(self, items: list[tuple[CopiedMesh, Instance]], shows: list[tuple[bool, ...]]) -> None:
        """shows: by item, of each slot whether it has a surface."""
        self._rows: list[np.ndarray] = []  # of each item's mesh
        share = min(MOST / max(sum(len(surface.real_mesh) for surface, _ in items), 1), 1.0)
        triangles = []
        for i, ((surface, instance), slots) in enumerate(zip(items, shows, strict=True)):
            progress.report(i / len(items))
            rows, corners = _shown(surface, np.array(slots), share)
            self._rows.append(rows)
            triangles.append(_transformed(corners, instance.matrix))
        self.triangles = np.concatenate([np.zeros((0, 3, 3), np.float32), *triangles])
        self._starts = np.cumsum([0, *map(len, self._rows)])
        self.center = self.triangles[:1].reshape(-1, 3)[:1].sum(axis=0)
        self.rays = Rays(self.triangles - self.center)

    def locate(self, triangle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(P,) items of triangles (P,), and (P,) their rows in the meshes of these."""
        item = np.searchsorted(self._starts, triangle, "right") - 1
        row = np.empty_like(triangle)
        for number in np.unique(item):
            own = item == number
            row[own] = self._rows[number][triangle[own] - self._starts[number]]
        return item, row


def _shown(surface: CopiedMesh, shows: np.ndarray, share: float) -> tuple[np.ndarray, np.ndarray]:
    """Rows (n,) of the mesh, and their corners (n, 3, 3), enlarged where they stand for others.

    shows: (k,) bool, slots that have a surface. share: of the rows that are wanted.
    """
    mesh = surface.real_mesh
    rows, growth = np.flatnonzero(shows[surface.find_slots(mesh)]), None
    if len(rows) * share > LEAST and share < 1:
        is_kept, growth = keep_sample(np.ones(len(rows)), len(rows) * share)
        rows, growth = rows[is_kept], growth[is_kept, None, None]
    corners = mesh.corners[rows]
    if growth is not None:
        middle = corners.mean(axis=1, keepdims=True)
        corners = middle + (corners - middle) * (MORE * growth)
    return rows, corners


def _transformed(corners: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    return (corners @ matrix[:3, :3].T.astype(np.float32) + matrix[:3, 3]).astype(np.float32)


def _evaluated(material: Material | None, mesh: TriangleMesh, instance: Instance, row: np.ndarray,
               share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(P, 3) colour and (P,) share of light straight through, at points with these weights of corners (P, 3)."""
    if material is None:
        return np.full((len(row), 3), 0.8, np.float32), np.zeros(len(row), np.float32)
    # Four points without an extent: nodes that compare neighbours find some, images are read as they are.
    points = surface_points(mesh, instance, row, np.tile(share[:, None, None], (1, 2, 2, 1)), True, Ray.CAMERA)
    with np.errstate(all="ignore"):
        surface = evaluate_material(material, points, Report()).surface
        color = surface.base_color + surface.emission
    color = np.nan_to_num(_first(color, len(row))).clip(0, BRIGHTEST)
    return color, _first(surface.clear, len(row)).mean(axis=1)


def _first(values: np.ndarray, count: int) -> np.ndarray:
    """(count, c) of values (c,), or of the first point of (count, r, c, c)."""
    return np.broadcast_to(values if values.ndim == 1 else values[:, 0, 0], (count, values.shape[-1]))
