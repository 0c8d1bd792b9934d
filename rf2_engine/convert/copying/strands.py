# SPDX-License-Identifier: GPL-3.0-or-later
"""Hair and point clouds as a few triangles: a sample of them, enlarged to cover the same area (sampling.py).

They are chosen by their index, so the same ones are kept when they move.
"""
from __future__ import annotations

import numpy as np

from ..data import mesh as meshes
from ..data.mesh import TriangleMesh
from ..meshes.sampling import keep_sample

TRIANGLES = 1024  # of one object
KNOTS = 5         # points along a strand
STRANDS = TRIANGLES // (2 * (KNOTS - 1))
OCTAHEDRON = np.float32([(1, 0, 0), (0, 1, 0), (0, 0, 1), (-1, 0, 0), (0, -1, 0), (0, 0, -1)])
SIDES = np.array([(0, 1, 2), (1, 3, 2), (3, 4, 2), (4, 0, 2), (1, 0, 5), (3, 1, 5), (4, 3, 5), (0, 4, 5)])
GOLDEN = 2.399963  # radians, which spread any number of turns


def read_curves(curves) -> TriangleMesh:
    """Ribbons along a `bpy.types.Curves`, in its own frame."""
    position, first, size = _points(curves), *(_read(curves.curves, name, 1, np.int32)[:, 0]
                                               for name in ("first_point_index", "points_length"))
    first, size = first[size > 1], size[size > 1]
    chosen, growth = keep_sample(np.ones(len(first)), STRANDS)
    first, size, growth = first[chosen, None], size[chosen, None], growth[chosen, None]
    along = np.linspace(0, 1, KNOTS) * (size - 1)
    low = np.minimum(along.astype(int), size - 2)
    part = (along - low)[..., None]
    knots, radius = (values[first + low] * (1 - part) + values[first + low + 1] * part
                     for values in (position, _radius(curves, 0.005)))
    return _ribbons(knots, radius[..., 0] * growth ** 2)


def read_particles(obj, system) -> TriangleMesh:
    """Ribbons along the hair of an evaluated particle system of an object, in its frame."""
    settings, steps = system.settings, 2 ** system.settings.render_step
    count = len(system.child_particles) or len(system.particles)
    parents = len(system.particles) if len(system.child_particles) else 0
    some, growth = keep_sample(np.ones(count), STRANDS)
    chosen = np.flatnonzero(some)
    at = np.linspace(0, steps, KNOTS).astype(int).tolist()
    knots = np.array([[system.co_hair(obj, particle_no=parents + i, step=step) for step in at]
                      for i in chosen.tolist()], np.float64).reshape(-1, KNOTS, 3)
    to_object = np.linalg.pinv(np.array(obj.matrix_world, np.float64))
    radius = np.linspace(settings.root_radius, settings.tip_radius, KNOTS) * settings.radius_scale / 2
    grown = np.ptp(knots, axis=1).any(axis=1)
    return _ribbons((knots @ to_object[:3, :3].T + to_object[:3, 3])[grown],
                    radius * growth[chosen[grown], None] ** 2)


def read_point_cloud(cloud) -> TriangleMesh:
    """Octahedra that replace the balls of a `bpy.types.PointCloud`, in its own frame."""
    position, radius = _points(cloud), _radius(cloud, 0.05)[:, 0].astype(np.float64)
    chosen, growth = keep_sample(np.nan_to_num(radius, posinf=0, neginf=0) ** 2, TRIANGLES // len(SIDES))
    size = (radius * growth)[chosen] * np.sqrt(np.pi / np.sqrt(3))  # an octahedron as large as the ball
    corners = position[chosen, None, None] + OCTAHEDRON[SIDES] * size[:, None, None, None]
    normals = np.broadcast_to(OCTAHEDRON[SIDES], corners.shape)
    return _mesh(corners.reshape(-1, 3, 3), normals.reshape(-1, 3, 3))


def _ribbons(knots: np.ndarray, radius: np.ndarray) -> TriangleMesh:
    """Flat strands along (s, KNOTS, 3) knots, turned at random, as wide as tubes of (s, KNOTS) radii on average."""
    tangent = np.gradient(knots, axis=1)
    turn = np.arange(len(knots)) * GOLDEN
    other = np.stack([np.cos(turn), np.sin(turn), 0.3 + 0 * turn], axis=-1)[:, None]
    side = meshes.unit_or(np.cross(tangent, other), np.float32([1, 0, 0]))
    front = meshes.unit_or(np.cross(side, tangent), np.float32([0, 0, 1]))
    half = side * (radius * np.pi / 2)[..., None]
    left, right = knots - half, knots + half
    a, b, c, d = left[:, :-1], right[:, :-1], right[:, 1:], left[:, 1:]
    corners = np.stack([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)], axis=2)
    below, above = front[:, :-1], front[:, 1:]
    normals = np.stack([np.stack([below, below, above], axis=2), np.stack([below, above, above], axis=2)], axis=2)
    return _mesh(corners.reshape(-1, 3, 3), normals.reshape(-1, 3, 3))


def _mesh(corners: np.ndarray, normals: np.ndarray) -> TriangleMesh:
    corners, normals = corners.astype(np.float32), normals.astype(np.float32)
    usable = np.isfinite(corners).all(axis=(1, 2))
    usable[usable] = meshes.has_area(corners[usable])
    space = np.float32([(0, 0, 0), (1, 1, 1)])
    return TriangleMesh(corners[usable], normals[usable], {}, None, {}, None, np.zeros(usable.sum(), np.int32), space)


def _points(data) -> np.ndarray:
    if (position := data.attributes.get("position")) is None:  # there are no points
        return np.zeros((0, 3), np.float32)
    return _read(position.data, "vector", 3)


def _radius(data, default: float) -> np.ndarray:
    if (radius := data.attributes.get("radius")) is None:
        return np.full((len(data.points), 1), default)
    return _read(radius.data, "value", 1)


def _read(collection, attribute: str, channels: int, dtype=np.float32) -> np.ndarray:
    values = np.empty(channels * len(collection), dtype)
    collection.foreach_get(attribute, values)
    return values.reshape(-1, channels)
