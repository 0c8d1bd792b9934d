# SPDX-License-Identifier: GPL-3.0-or-later
"""Emitters with a closed form, and merging many of them into a few that give the same light from a distance."""
from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...clusters import split_clusters
from .outlines import outline_vectors, padded, ring_points, rings
from .pictures import BUT_RADIANCE, LIGHT, Picture

NO_SHELL = np.zeros(3, np.float32)  # as an outward normal
FACING, COLOR, BEAM = 0.3, 0.1, 0.3  # how much differences in these count beside a distance of the scene's radius


@dataclass
class Emitters:
    """P flat convex polygons and S spheres; radiance in the scene's units; a beam axis of length 0 is no beam."""

    corners: np.ndarray      # (P, K, 3) f32, see outlines.py; without beam they radiate to both sides
    centers: np.ndarray      # (S, 3) f32
    radii: np.ndarray        # (S,) f32
    radiance: np.ndarray     # (P + S, 3) f32
    beam_axis: np.ndarray    # (P + S, 3) f32
    beam_cosine: np.ndarray  # (P + S, 2) f32
    kind: np.ndarray         # (P + S,) i32, the same for light that goes to the same surfaces
    outward: np.ndarray      # (P, 3) f32, unit normals of the outside of shells, which hide what the inside sends there
    pictures: tuple[Picture, ...] = ()  # the last polygons are their cells,
    cells: int = 0                      # so many of each

    def __len__(self) -> int:
        return len(self.radiance)

    @cached_property
    def middles(self) -> np.ndarray:
        """(P, 3) of the polygons."""
        return ring_points(rings(self.corners)).mean(axis=1)

    @classmethod
    def of(cls, polygons: list[tuple], spheres: list[tuple]) -> Emitters:
        """polygons: (corners (K, 3), outward, light), spheres: (center, radius, light).

        light: (len(LIGHT),); outward: (3,), 0 of what is no shell.
        """
        light = np.array([p[-1] for p in polygons] + [s[-1] for s in spheres], np.float32).reshape(-1, len(LIGHT))
        return cls(
            corners=padded([p[0] for p in polygons]),
            centers=np.array([s[0] for s in spheres], np.float32).reshape(-1, 3),
            radii=np.array([s[1] for s in spheres], np.float32),
            radiance=light[:, LIGHT["radiance"]], beam_axis=light[:, LIGHT["beam_axis"]],
            beam_cosine=light[:, LIGHT["beam_cosine"]], kind=light[:, LIGHT["kind"]][:, 0].astype(np.int32),
            outward=np.array([p[1] for p in polygons], np.float32).reshape(-1, 3))

    def beside(self, pictures: list[Picture], cells: int, light: np.ndarray) -> Emitters:
        """These, and after their polygons so many cells of each picture, of triangles that shine with light
        (L, len(LIGHT))."""
        own = np.concatenate([self.radiance, self.beam_axis, self.beam_cosine, self.kind[:, None]], axis=1)
        polygons = list(zip(self.corners, self.outward, own, strict=False))
        spheres = zip(self.centers, self.radii, own[len(polygons):], strict=True)
        for picture in pictures:
            polygons += [(outline, NO_SHELL, np.concatenate([radiance, light[picture.rows[0], BUT_RADIANCE]]))
                         for outline, radiance in picture.cells(cells)]
        return replace(Emitters.of(polygons, list(spheres)), pictures=tuple(pictures), cells=cells)


def merged(emitters: Emitters, most: int, center: np.ndarray, radius: float) -> Emitters:
    """At most `most` emitters: those that are near each other, seen from the scene's bounding sphere, become one.

    For each colour the sum of radiance times vector area (of a sphere: times area) stays as it is.
    """
    vectors, count = outline_vectors(emitters.corners.astype(np.float64)), len(emitters.corners)
    size = np.concatenate([np.linalg.norm(vectors, axis=1), 2 * np.pi * emitters.radii.astype(np.float64) ** 2])
    power = np.maximum(size * emitters.radiance.mean(axis=1), 1e-30)
    kinds = [rows[emitters.kind[rows] == kind] for rows in np.split(np.arange(len(emitters)), [count])
             for kind in np.unique(emitters.kind[rows])]
    polygons, spheres = [], []
    for rows in split_clusters(_features(emitters, vectors, center, radius), power, kinds, most):
        if rows[0] >= count:
            spheres.append(_one_sphere(emitters, rows - count, power[rows]))
        else:
            polygons.append(_one_polygon(emitters, vectors[rows], rows, power[rows]))
    return Emitters.of(polygons, spheres)


def triangle(vector: np.ndarray, center: np.ndarray) -> np.ndarray:
    """(3, 3) equilateral triangle with this vector area (3,) and centroid (3,)."""
    area = np.linalg.norm(vector)
    normal = vector / max(area, 1e-20)
    side = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    side /= np.linalg.norm(side)
    up = np.cross(normal, side)
    radius = np.sqrt(area * 4 / (3 * np.sqrt(3)))
    angles = 2 * np.pi * np.arange(3) / 3
    return center + radius * (np.cos(angles)[:, None] * side + np.sin(angles)[:, None] * up)


def _features(emitters: Emitters, vectors: np.ndarray, center: np.ndarray, radius: float) -> np.ndarray:
    """(P + S, K) coordinates in which emitters that may replace each other are close."""
    place = np.concatenate([emitters.middles, emitters.centers]) - center
    place = place / np.maximum(np.linalg.norm(place, axis=1, keepdims=True), radius)  # outside only directions differ
    normal = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-30)
    facing = np.zeros((len(emitters), 9))
    facing[:len(normal)] = (normal[:, :, None] * normal[:, None]).reshape(-1, 9)  # the same for both sides
    color = emitters.radiance / emitters.radiance.sum(axis=1, keepdims=True)
    return np.concatenate([place, FACING * facing, COLOR * color, BEAM * emitters.beam_axis,
                           BEAM * emitters.beam_cosine], axis=1)


def _one_polygon(emitters: Emitters, vectors: np.ndarray, rows: np.ndarray, power: np.ndarray) -> tuple:
    if len(rows) == 1:
        row = rows[0]
        return emitters.corners[row], emitters.outward[row], _light(emitters, rows, power, emitters.radiance[row])
    _, axes = np.linalg.eigh(vectors.T @ vectors)
    vectors = vectors * np.where(vectors @ axes[:, -1] < 0, -1, 1)[:, None]  # of two opposite sides neither is lost
    total = vectors.sum(axis=0)
    share = vectors @ total / max(total @ total, 1e-300)
    center = np.average(emitters.middles[rows], axis=0, weights=power)
    return triangle(total, center), NO_SHELL, _light(emitters, rows, power, share @ emitters.radiance[rows])


def _one_sphere(emitters: Emitters, rows: np.ndarray, power: np.ndarray) -> tuple:
    area, behind = emitters.radii[rows].astype(np.float64) ** 2, rows + len(emitters.corners)
    center = np.average(emitters.centers[rows], axis=0, weights=power)
    radiance = area @ emitters.radiance[behind] / area.sum()
    return center, np.sqrt(area.sum()), _light(emitters, behind, power, radiance)


def _light(emitters: Emitters, rows: np.ndarray, power: np.ndarray, radiance: np.ndarray) -> np.ndarray:
    """(len(LIGHT),) radiance and the mean beam; no beam if those of `rows`, which are of one kind, diverge."""
    axis = np.average(emitters.beam_axis[rows], axis=0, weights=power)
    length = np.linalg.norm(axis)
    axis = axis / length if length > 0.5 else 0 * axis
    return np.concatenate([radiance, axis, np.average(emitters.beam_cosine[rows], axis=0, weights=power),
                           emitters.kind[rows[:1]]])
