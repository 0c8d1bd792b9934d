# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles and rotations in numpy; the frame is right-handed and Z-up (docs/scene-input.md 1)."""
from __future__ import annotations

from functools import reduce

import numpy as np

from . import progress

LEAST_IOR = 0.4  # of glass, over that of what is around it: air in glass of 2.5


def area_vectors(corners: np.ndarray) -> np.ndarray:
    """(..., 3, 3) corners -> (..., 3): the triangle's normal times its area."""
    u, v = corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :]
    (ux, uy, uz), (vx, vy, vz) = ((edge[..., 0], edge[..., 1], edge[..., 2]) for edge in (u, v))
    return np.stack([uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx], axis=-1) / 2


def contracted(points):
    """(..., 3) array or tensor in which what is farther than 1 from the origin was drawn in, infinity to 2.

    Barron et al. 2022, "Mip-NeRF 360", equation 10.
    """
    length = ((points * points).sum(-1)[..., None] ** 0.5).clip(1)
    return points * ((2 - 1 / length) / length)


def uncontracted(points):
    """The inverse of `contracted`, for what is not infinitely far."""
    length = ((points * points).sum(-1)[..., None] ** 0.5).clip(1, 1.9999)
    return points / (length * (2 - length))


def quartered(corners):
    """(S, 3, C) array or tensor of triangles -> (4 S, 3, C): those at corners 0, 1 and 2, then those in the middle."""
    ends = [[[0, 0], [0, 1], [0, 2]], [[1, 1], [1, 2], [1, 0]], [[2, 2], [2, 0], [2, 1]], [[0, 1], [1, 2], [2, 0]]]
    halves = corners[:, ends].sum(3) / 2  # S, quarter, corner, axis
    return halves.swapaxes(0, 1).reshape(-1, *corners.shape[1:])


def connected(faces: np.ndarray, count: int) -> np.ndarray:
    """(count,) for each point the first one of those that (n, k) faces connect it with, directly or by others.

    Reports progress, which may cancel.
    """
    first = np.arange(count)
    while len(faces):
        progress.report()
        roots = [first[corner] for corner in faces.T]
        least = reduce(np.minimum, roots)
        apart = np.any([root != least for root in roots], axis=0)
        faces, least = faces[apart], least[apart]
        for root in roots:
            np.minimum.at(first, root[apart], least)
        while (first != first[first]).any():
            first = first[first]
    return first


def pieces(faces: np.ndarray, count: int) -> np.ndarray:
    """(count,) i64 number of the piece that each point is of, as `connected`, by the order of their first points."""
    first = connected(faces, count)
    return (np.cumsum(first == np.arange(count)) - 1)[first]


def surfaces(corners: np.ndarray, kinds: np.ndarray | None = None) -> np.ndarray:
    """(N,) i64: which surface each of (N, 3, 3) triangles is part of, those that share places of corners being one.

    With `kinds` (N, K), equal ones alone are.
    """
    if not len(corners):
        return np.zeros(0, np.int64)
    places = corners.reshape(-1, 3).round(6)
    if kinds is not None:
        kind = np.unique(kinds, axis=0, return_inverse=True)[1].reshape(-1)
        places = np.column_stack([places, kind.repeat(3)])
    _, vertex = np.unique(places, axis=0, return_inverse=True)
    vertex = vertex.reshape(-1, 3)
    return pieces(vertex, vertex.max() + 1)[vertex[:, 0]]


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(...) of vectors (..., C): several times as fast as a sum of products over so short an axis."""
    return np.einsum("...c,...c->...", a, b)


def unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors (..., C) of length 1 along others; 0 along 0."""
    return vectors / np.sqrt(dot(vectors, vectors)).clip(1e-20)[..., None]


def corner_weights(first_two: np.ndarray) -> np.ndarray:
    """(..., 2) barycentric weights of the corners 0 and 1 -> (..., 3), those of all."""
    return np.concatenate([first_two, 1 - first_two.sum(-1, keepdims=True)], axis=-1)


def interpolated(weights: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(P, C) what triangles with (P, 3, C) at their corners have where these have weights (P, 3)."""
    return np.einsum("pk,pkc->pc", weights, corners)


def barycentric(triangles: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(..., 3) f64 weights of the corners of (..., 3, 3) triangles at the projections of (..., 3) points.

    They sum to 1, are negative outside, and 1/3 each where a triangle has no area.
    """
    a, b, c = (triangles[..., i, :].astype(np.float64) for i in range(3))
    u, v, w = a - c, b - c, points - c
    uu, uv, vv, wu, wv = dot(u, u), dot(u, v), dot(v, v), dot(w, u), dot(w, v)
    area = uu * vv - uv * uv
    flat = area <= 1e-20 * np.maximum(uu, vv) ** 2
    first, second = (x / np.where(flat, 1, area) for x in (vv * wu - uv * wv, uu * wv - uv * wu))
    return np.where(flat[..., None], 1 / 3, np.stack([first, second, 1 - first - second], axis=-1))


def rotation_matrix(euler: np.ndarray) -> np.ndarray:
    """(3, 3) f64 Rz Ry Rx of (3,) XYZ Euler angles in radians, Blender's default order."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(euler), np.sin(euler)
    x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return z @ y @ x


def euler_angles(rotation: np.ndarray) -> np.ndarray:
    """(3,) f64 radians such that `rotation_matrix` gives `rotation` back; the second within [-pi/2, pi/2]."""
    cosine = np.hypot(rotation[0, 0], rotation[1, 0])
    y = np.arctan2(-rotation[2, 0], cosine)
    if cosine < 1e-6:  # the first and the third turn about the same axis
        return np.array([np.arctan2(-rotation[1, 2], rotation[1, 1]), y, 0.0])
    return np.array([np.arctan2(rotation[2, 1], rotation[2, 2]), y, np.arctan2(rotation[1, 0], rotation[0, 0])])


def latlong_directions(rows: np.ndarray, height: int, width: int) -> np.ndarray:
    """(len(rows), width, 3) f32 unit directions of the texel centres in these rows of a (height, width) panorama.

    Row 0 looks up, +Z; the centre looks along +X (docs/scene-input.md 7.1).
    """
    theta = np.pi * (rows[:, None] + 0.5) / height
    phi = 2 * np.pi * (0.5 - (np.arange(width)[None] + 0.5) / width)
    x, y = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi)
    return np.stack(np.broadcast_arrays(x, y, np.cos(theta)), axis=-1).astype(np.float32)


def latlong_uv(directions: np.ndarray) -> np.ndarray:
    """(..., 3) unit directions -> (..., 2): u from 0 on the left to 1, v from 0 at the bottom of a panorama to 1."""
    x, y, z = np.moveaxis(directions, -1, 0)
    return np.stack([0.5 - np.arctan2(y, x) / (2 * np.pi), 0.5 + np.arcsin(np.clip(z, -1, 1)) / np.pi], axis=-1)


def nearest_texels(panorama: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """(P, C) nearest texels of (H, W, C), whose top row is +Z, along unit world rays (P, 3)."""
    u, v = np.moveaxis(latlong_uv(rays), -1, 0)
    height, width = panorama.shape[:2]
    return panorama[((1 - v) * height).astype(int).clip(0, height - 1), (u * width).astype(int) % width]


def reflected(ray, normal):
    """Unit rays (..., 3), arrays or tensors, mirrored at unit normals (..., 3)."""
    return ray - 2 * (ray * normal).sum(-1)[..., None] * normal


def refracted(ray: np.ndarray, normal: np.ndarray, ior: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Unit rays (P, 3) behind a surface whose unit normals (P, 3) face them; mirrored where nothing passes.

    ior: (P,) of the medium behind the surface's front, over that before it; inside: (P,), whether the rays come from
    within.
    """
    ior = np.maximum(ior, LEAST_IOR)
    ratio = np.where(inside, ior, 1 / ior)
    cosine = -dot(ray, normal)
    rest = 1 - ratio**2 * (1 - cosine**2)
    through = ratio[:, None] * ray + (ratio * cosine - np.sqrt(np.maximum(rest, 0)))[:, None] * normal
    return np.where(rest[:, None] > 0, through, reflected(ray, normal))


def facing(normal: np.ndarray, ray: np.ndarray) -> np.ndarray:
    """Normals (..., 3), turned where they point along the ray (..., 3)."""
    return np.where(dot(normal, ray)[..., None] > 0, -normal, normal)
