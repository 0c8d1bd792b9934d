# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangle shapes that replace lamps: rectangles, disks, balls and shades.

All return (n, 3, 3) f64, counter-clockwise from the front, in the frame of the lamp: it shines along -Z.
"""
from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np

from ....model.geometry import area_vectors
from ....model.scene import RenderScene, constant_tile
from ..data.copied import Reach

SHADE_MAX_ANGLE = np.radians(80)
TILES = np.stack([constant_tile((1, 1, 1), roughness=1, ior=1), constant_tile((0, 0, 0), roughness=1, ior=1)])
EMITTING, BLACK = 0, 1  # rows of TILES


def rectangle(width: float, height: float, columns: int = 1, rows: int = 1) -> np.ndarray:
    """A rectangle in the plane z = 0, front towards -Z, cut into `columns` x `rows` cells of two triangles."""
    x = np.linspace(-width / 2, width / 2, columns + 1)
    y = np.linspace(-height / 2, height / 2, rows + 1)
    x0, y0 = (a.ravel() for a in np.meshgrid(x[:-1], y[:-1]))
    x1, y1 = (a.ravel() for a in np.meshgrid(x[1:], y[1:]))

    def corner(px, py):
        return np.stack([px, py, np.zeros_like(px)], axis=-1)

    a, b, c, d = corner(x0, y0), corner(x0, y1), corner(x1, y1), corner(x1, y0)
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def disk(width: float, height: float, corners: int) -> np.ndarray:
    """A fan in the plane z = 0, front towards -Z, of the area of the ellipse with these diameters."""
    angle = np.arange(corners) * 2 * np.pi / corners
    grow = np.sqrt(np.pi / (corners / 2 * np.sin(2 * np.pi / corners)))
    rim = np.stack([np.cos(angle) * width / 2, -np.sin(angle) * height / 2, 0 * angle], axis=-1) * grow
    return np.stack([np.zeros_like(rim), rim, np.roll(rim, -1, axis=0)], axis=1)


def ball(radius: float, faces: int) -> np.ndarray:
    """Icosahedron (20 faces) or octahedron (8) with the area of the sphere of this radius.

    From some sides it looks larger or smaller than the sphere: by up to 4 % and 18 %.
    """
    golden = (1 + np.sqrt(5)) / 2
    some = {20: [(0, s, t * golden) for s in (-1, 1) for t in (-1, 1)], 8: [(0, 0, -1), (0, 0, 1)]}[faces]
    corners = np.concatenate([np.roll(np.array(some, np.float64), turn, axis=1) for turn in range(3)])
    distance = np.linalg.norm(corners[:, None] - corners[None], axis=-1)
    near = np.isclose(distance, distance[distance > 0].min())
    triangles = corners[[(i, j, k) for i, j, k in combinations(range(len(corners)), 3)
                         if near[i, j] and near[j, k] and near[i, k]]]
    inward = np.einsum("nc,nc->n", normals(triangles), triangles.mean(axis=1)) < 0
    triangles[inward] = triangles[inward][:, ::-1]
    return triangles * (radius * np.sqrt(4 * np.pi / area(triangles)))


def shade(half_angle: float, radius: float, sides: int) -> np.ndarray:
    """Lampshade around a ball of this radius at the origin: a tube closed behind, open in front along -Z.

    Its rim lies on the cone of `half_angle` unless the tube would become too long (narrow cones) or too wide.
    """
    slope = np.tan(min(half_angle, SHADE_MAX_ANGLE))
    outer = radius * np.clip(4 * slope, 1.3, 4)
    depth, top = min(outer / slope, 8 * radius), 1.5 * radius
    angle = np.arange(sides) * 2 * np.pi / sides
    circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1) * outer / np.cos(np.pi / sides)
    front, back = circle - [0, 0, depth], circle + [0, 0, top]
    front_next, back_next = np.roll(front, -1, axis=0), np.roll(back, -1, axis=0)
    middle = np.broadcast_to([0.0, 0.0, top], back.shape)
    return np.concatenate([np.stack([front, front_next, back_next], axis=1), np.stack([front, back_next, back], axis=1),
                           np.stack([middle, back, back_next], axis=1)])


def area(triangles: np.ndarray) -> float:
    return float(np.linalg.norm(area_vectors(triangles), axis=1).sum())


def normals(triangles: np.ndarray) -> np.ndarray:
    """(n, 3) unit face normals."""
    vectors = area_vectors(triangles)
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def black(triangles: np.ndarray) -> RenderScene:
    """What casts shadows and reflects nothing, of (n, 3, 3) corners."""
    return shining(triangles, np.zeros(3), tile=BLACK)


def shining(triangles: np.ndarray, radiance, axis=(0, 0, 0), cosines=(0, 0), tile: int = EMITTING) -> RenderScene:
    """(n, 3, 3) flat triangles of one radiance (3,), or of (n, 3), that share a beam (model/scene.py) and a tile."""
    n = len(triangles)

    def per_triangle(value, *shape):
        return np.broadcast_to(np.float32(value), (n, *shape)).copy()

    flat = np.repeat(normals(triangles)[:, None], 3, axis=1) if n else triangles
    return RenderScene(
        triangles=triangles.astype(np.float32), normals=flat.astype(np.float32), emission=per_triangle(radiance, 3),
        beam_axis=per_triangle(axis, 3), beam_cosine=per_triangle(cosines, 2), tile_index=np.full(n, tile, np.int32),
        tiles=TILES.copy(), seen=np.zeros(n, bool))


DARK = black(np.zeros((0, 3, 3)))


def reaching(shape: RenderScene, reach: Reach) -> RenderScene:
    """A lamp's triangles, from which light goes there."""
    if reach == Reach():
        return shape
    return replace(shape, **{name: np.full(len(shape), value, dtype) for name, value, dtype in (
        ("hidden", reach.hidden, np.uint8), ("light_bounces", reach.bounces, np.uint8),
        ("lit_groups", reach.groups, np.uint64), ("blockers", reach.blockers, np.uint64))})


def reach_of(shape: RenderScene) -> Reach:
    """Where the light of a lamp's triangles goes."""
    return Reach(*(int(values[0]) for values in (
        shape.hidden_from, shape.seldom("light_bounces"), shape.seldom("lit_groups"), shape.seldom("blockers"))))
