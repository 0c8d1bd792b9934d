# SPDX-License-Identifier: GPL-3.0-or-later
"""Hair and point clouds as triangles: all of them for rays, a few enlarged ones as tokens (meshes/sampling.py).

They are chosen by their index, so the same ones are kept when they move.
"""
from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ....model.geometry import quartered, unit
from ..data import mesh as meshes
from ..data.mesh import TriangleMesh
from ..data.report import Report
from ..meshes.sampling import keep_sample
from ..shading.input_nodes import CURVES_INFO, POINT_INFO
from ..shading.noise.hashing import LARGEST, jenkins
from .attributes import read_layers, read_values

TOKENS = 1024     # triangles of one object that become tokens
REAL = 1_000_000  # ... that rays meet
KNOTS = 5         # points along a strand of tokens
REAL_KNOTS = 9    # ... that rays meet, at most
OCTAHEDRON = np.float32([(1, 0, 0), (0, 1, 0), (0, 0, 1), (-1, 0, 0), (0, -1, 0), (0, 0, -1)])
SIDES = np.array([(0, 1, 2), (1, 3, 2), (3, 4, 2), (4, 0, 2), (1, 0, 5), (3, 1, 5), (4, 3, 5), (0, 4, 5)])
FINER = 2         # times that the sides of an octahedron are quartered, at most
GOLDEN = 2.399963  # radians, which spread any number of turns


class Knots(NamedTuple):
    """Points along s strands, k of each."""

    position: np.ndarray           # (s, k, 3)
    radius: np.ndarray             # (s, k)
    layers: dict[str, np.ndarray]  # attributes by name, (s, k or 1, c)


class Strands(NamedTuple):
    """Hair or points of an object, in its own frame."""

    tokens: TriangleMesh  # a sample of them that covers the same area
    real: TriangleMesh    # what rays meet


def read_curves(obj, report: Report, requested: set[str]) -> Strands:
    """Strands along the `bpy.types.Curves` of an object. requested: names of attributes that materials read."""
    curves = obj.data
    position, first, size = _points(curves), *(read_values(curves.curves, name, dtype=np.int32)
                                               for name in ("first_point_index", "points_length"))
    radius, of_points = _radius(curves, 0.005), read_layers(curves, requested, "POINT")
    of_curves = {name: values[size > 1, None] for name, values in read_layers(curves, requested, "CURVE").items()}
    first, size = first[size > 1], size[size > 1]

    def knots_of(rows: np.ndarray, count: int) -> Knots:
        begin, length = first[rows, None], size[rows, None]
        along = np.linspace(0, 1, count) * (length - 1)
        low = np.minimum(along.astype(int), length - 2)
        part = (along - low)[..., None]

        def between(values: np.ndarray) -> np.ndarray:
            return values[begin + low] * (1 - part) + values[begin + low + 1] * part

        layers = {name: between(values) for name, values in of_points.items()}
        layers |= {name: values[rows] for name, values in of_curves.items()}
        return Knots(between(position), between(radius)[..., 0], layers)

    return _strands(obj, len(first), int(size.max(initial=2)), knots_of, requested, report)


def read_particles(obj, system, is_render: bool, report: Report, requested: set[str]) -> Strands:
    """The hair of a particle system of an object, evaluated for a render or for a viewport."""
    settings = system.settings
    steps = 2 ** (settings.render_step if is_render else settings.display_step)
    count = len(system.child_particles) or len(system.particles)
    parents = len(system.particles) if len(system.child_particles) else 0
    to_object = np.linalg.pinv(np.array(obj.matrix_world, np.float64))

    def knots_of(rows: np.ndarray, count: int) -> Knots:
        at = np.linspace(0, steps, count).astype(int).tolist()
        knots = np.array([[system.co_hair(obj, particle_no=parents + i, step=step) for step in at]
                          for i in rows.tolist()], np.float64).reshape(-1, count, 3)
        radius = _particle_radius(settings, np.array(at) / steps)
        return Knots(knots @ to_object[:3, :3].T + to_object[:3, 3], np.tile(radius, (len(rows), 1)), {})

    return _strands(obj, count, steps + 1, knots_of, requested, report)


def _particle_radius(settings, along: np.ndarray) -> np.ndarray:
    """Radius of hair at fractions of its length from root to tip, as Cycles shapes it."""
    toward_root = (1 - along) ** (1 + settings.shape if settings.shape < 0 else 1 / max(1 - settings.shape, 1e-5))
    width = settings.tip_radius + (settings.root_radius - settings.tip_radius) * toward_root
    return np.where(settings.use_close_tip & (along == 1), 0, width) * settings.radius_scale / 2


def read_point_cloud(obj, report: Report, requested: set[str]) -> Strands:
    """Balls of the `bpy.types.PointCloud` of an object: octahedra, with quartered sides where there is room."""
    position, radius = _points(obj.data), _radius(obj.data, 0.05)[:, 0].astype(np.float64)
    area = np.nan_to_num(radius, posinf=0, neginf=0) ** 2
    finer = next((n for n in range(FINER, 0, -1) if len(SIDES) * 4 ** n * len(area) <= REAL), 0)
    info = {"Position": position, "Radius": radius[:, None], "Random": _random(np.arange(len(area)))[:, None]}
    layers = read_layers(obj.data, requested, "POINT") | _asked(POINT_INFO, info, requested)

    def balls(most: int, finer: int) -> TriangleMesh:
        is_kept, growth = keep_sample(area, most)
        ball = OCTAHEDRON[SIDES]
        for _ in range(finer):
            ball = unit(quartered(ball))
        size = (radius * growth)[is_kept] * np.sqrt(4 * np.pi / meshes.areas(ball).sum())  # as large as the ball
        corners = position[is_kept, None, None] + ball * size[:, None, None, None]
        return _mesh(corners, np.broadcast_to(unit(ball), corners.shape),
                     {name: np.broadcast_to(values[is_kept, None, None], (*corners.shape[:3], values.shape[1]))
                      for name, values in layers.items()})

    few, many = TOKENS // len(SIDES), REAL // len(SIDES)
    _report(obj, "points", len(area), few, many, report)
    return Strands(balls(few, 0), balls(many, finer))


def _strands(obj, count: int, longest: int, knots_of: Callable[[np.ndarray, int], Knots], requested: set[str],
             report: Report) -> Strands:
    """knots_of: that many knots of the strands with indices (s,). longest: most points of a strand."""
    def ribbons(most: int, knots: int, is_crossed: bool) -> TriangleMesh:
        is_kept, growth = keep_sample(np.ones(count), most)
        rows = np.flatnonzero(is_kept)
        of_rows = knots_of(rows, knots)
        layers = of_rows.layers | _asked(CURVES_INFO, _info(rows, of_rows), requested)
        return _ribbons(of_rows.position, of_rows.radius * growth[is_kept, None] ** 2, layers, is_crossed)

    knots = min(longest, REAL_KNOTS)
    few, many = TOKENS // (2 * (KNOTS - 1)), REAL // (4 * (knots - 1))
    _report(obj, "strands", count, few, many, report)
    return Strands(ribbons(few, KNOTS, False), ribbons(many, knots, True))


def _info(rows: np.ndarray, knots: Knots) -> dict[str, np.ndarray]:
    """What Curves Info tells of strands (s,), but for Tangent Normal, which depends on the view."""
    along = np.cumsum(meshes.lengths(np.diff(knots.position, axis=1, prepend=knots.position[:, :1])), axis=1)[..., None]
    length = along[:, -1:]
    return {"Is Strand": np.ones_like(length), "Intercept": along / length.clip(1e-30), "Length": length,
            "Thickness": 2 * knots.radius[..., None], "Random": _random(rows)[:, None, None]}


def _asked(node: str, info: dict[str, np.ndarray], requested: set[str]) -> dict[str, np.ndarray]:
    """What materials ask a node, as attributes."""
    return {name: values for output, values in info.items() if (name := node + output) in requested}


def _random(index: np.ndarray) -> np.ndarray:
    """Cycles' number from 0 to 1 for each strand or point."""
    return jenkins(index, 0) / LARGEST


def _report(obj, what: str, count: int, few: int, many: int, report: Report) -> None:
    if count > few:
        report.approximated(obj.name, f"the network sees {few} of its {count:,} {what}, enlarged; rays meet "
                                      f"{f'{many:,}' if count > many else 'all'}")


def _ribbons(knots: np.ndarray, radius: np.ndarray, layers: dict[str, np.ndarray], is_crossed: bool) -> TriangleMesh:
    """Ribbons along (s, k, 3) knots with (s, k) radii: each turned otherwise, and as wide as a tube looks on average.

    layers: as of Knots. Crossed, two for each strand, which look nearly as wide from all sides.
    """
    tangent = np.gradient(knots, axis=1)
    turn = np.arange(len(knots)) * GOLDEN
    other = np.stack([np.cos(turn), np.sin(turn), 0.3 + 0 * turn], axis=-1)[:, None]
    side = meshes.unit_or(np.cross(tangent, other), np.float32([1, 0, 0]))
    front = meshes.unit_or(np.cross(side, tangent), np.float32([0, 0, 1]))
    if is_crossed:  # by Cauchy's formula: the perimeter of the square around a cross is that of the tube
        knots, radius = np.concatenate([knots] * 2), np.concatenate([radius] * 2) / np.sqrt(2)
        side, front = np.concatenate([side, front]), np.concatenate([front, -side])
        layers = {name: np.concatenate([values] * 2) for name, values in layers.items()}
    half = side * (radius * np.pi / 2)[..., None]
    across = [np.broadcast_to(values, (*knots.shape[:2], values.shape[2])) for values in layers.values()]
    return _mesh(_between(knots - half, knots + half), _between(front, front),
                 dict(zip(layers, (_between(values, values) for values in across), strict=True)))


def _between(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """(s, k - 1, 2, 3, c) at the corners of two triangles for each piece of ribbons with such sides, each (s, k, c)."""
    a, b, c, d = left[:, :-1], right[:, :-1], right[:, 1:], left[:, 1:]
    return np.stack([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)], axis=2)


def _mesh(corners: np.ndarray, normals: np.ndarray, layers: dict[str, np.ndarray]) -> TriangleMesh:
    """The mesh of corners and their normals (..., 3, 3) and attributes (..., 3, c), of triangles that have an area."""
    layers = {name: values.reshape(-1, *values.shape[-2:]).astype(np.float32) for name, values in layers.items()}
    corners, normals = (x.reshape(-1, 3, 3).astype(np.float32) for x in (corners, normals))
    usable = np.isfinite(corners).all(axis=(1, 2))
    usable[usable] = meshes.has_area(corners[usable])
    space = np.float32([(0, 0, 0), (1, 1, 1)])
    mesh = TriangleMesh(corners, normals, {}, None, layers, None, np.zeros(len(corners), np.int32), space)
    return mesh.take(usable)


def _points(data) -> np.ndarray:
    if (position := data.attributes.get("position")) is None:  # there are no points
        return np.zeros((0, 3), np.float32)
    return read_values(position.data, "vector", (3,))


def _radius(data, default: float) -> np.ndarray:
    if (radius := data.attributes.get("radius")) is None:
        return np.full((len(data.points), 1), default)
    return read_values(radius.data, "value", (1,))
