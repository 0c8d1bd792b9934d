# SPDX-License-Identifier: GPL-3.0-or-later
"""Normal Map and Bump: normals in world space as values, in the triangle's UV frame for the tile."""
from __future__ import annotations

import numpy as np

from ..data.arrays import divide_safely, dot, join, mix_values, unit
from .coordinates import normals_in_world
from .node_call import NodeCall, Unknown
from .points import Points

UP = np.array([0.0, 0.0, 1.0], np.float32)


def tangent_normal(n: NodeCall) -> np.ndarray:
    """(..., 3) normal that reaches the Normal input of `n`, in the UV frame (docs/scene-input.md 4.4)."""
    source = n.source("Normal")
    if source is None or (source.kind == "ShaderNodeNewGeometry" and source.output.name == "Normal"):
        return UP
    if source.kind == "ShaderNodeNormalMap" and source.node.space == "TANGENT" and _is_flat(source):
        return UP
    if source.kind == "ShaderNodeNormalMap" and source.node.space == "TANGENT" and (
            source.node.uv_map in ("", n.points.active_uv)):
        return np.clip(_tilted(source), -1, 1)
    if n.points.corners is None:
        return UP
    if source.kind == "ShaderNodeBump":
        return _bumped(source)
    world = n["Normal"]
    return np.einsum("...b,...ab->...a", unit(world), _frame_in_world(n)) if np.any(world) else UP


def bump(n: NodeCall):
    return unit(_combined(_bumped(n), _frame_in_world(n)))


def normal_map(n: NodeCall):
    node, bent = n.node, 2 * n["Color"] - 1
    if n.points.corners is None:
        raise Unknown("there is no surface whose normal it could change")
    if node.space == "TANGENT":
        if _is_flat(n):
            return normals_in_world(n, n.points.normal)
        bent = _combined(_tilted(n), _frame(n.points.edges, n.points.uv_edges(node.uv_map), n.points.normal))
        return normals_in_world(n, bent)
    if node.space.startswith("BLENDER"):
        bent = bent * np.float32((1, -1, -1))
    if node.space.endswith("OBJECT"):
        bent = normals_in_world(n, bent)
    return unit(mix_values(normals_in_world(n, n.points.normal), unit(bent), np.maximum(n["Strength"], 0)))


def _is_flat(n: NodeCall) -> bool:
    """Whether a normal map in tangent space names a UV map that is not there, and so bends nothing in Cycles."""
    name = n.node.uv_map
    if n.points.corners is None or n.points.uv_edges(name) is not None:
        return False
    n.approximated(f'the mesh has no UV map "{name}", so it has no effect' if name else
                   "the mesh has no UV map, so its normals are wrong: unwrap the mesh")
    return bool(name)


def _tilted(n: NodeCall) -> np.ndarray:
    """The UV-frame normal of a normal map in this space."""
    x, y, z = np.split(2 * n["Color"] - 1, 3, axis=-1)
    strength = np.maximum(n["Strength"], 0)
    return join(x * strength, y * strength, mix_values(np.float32(1), z, np.minimum(strength, 1)))


def _bumped(n: NodeCall) -> np.ndarray:
    """UV-frame normal of a Bump node: the slope of its height from texel to texel."""
    push = -1 if n.node.invert else 1
    return bend_normal(n, tangent_normal(n), n["Height"], push * n["Distance"], n["Strength"])


def bend_normal(n: NodeCall, base: np.ndarray, height: np.ndarray, distance=1.0, strength=1.0) -> np.ndarray:
    """(m, r, c, 3) the UV-frame normal `base` bent by a height over the tile, times a distance in world units."""
    if height.ndim == 1 or n.points.corners is None:
        return base
    linear = n.linear_matrix()
    edges = n.points.edges @ np.float32(linear.T)                                 # (m, 2, 3) along columns and rows
    tangent, other = _across(edges, n.points.uv_edges())
    axes = np.stack([tangent, other], axis=-1)                                    # (m, 3, 2)
    along = edges @ axes                                                          # (m, 2, 2)
    size = height.shape[1]
    steps = np.stack([np.gradient(height[..., 0], axis=axis) * size for axis in (2, 1)], axis=-1)[..., None]
    slope = (_inverse(along)[:, None, None] @ steps)[..., 0]                      # (m, r, c, 2)
    bent = base - join(distance * slope, 0 * height)
    return unit(mix_values(base, unit(bent), np.maximum(strength, 0)))


def _inverse(matrices: np.ndarray) -> np.ndarray:
    """Inverses of (m, 2, 2) matrices; 0 for singular ones."""
    (a, b), (c, d) = np.moveaxis(matrices, 0, -1)
    determinant = a * d - b * c
    return divide_safely(np.stack([d, -b, -c, a], axis=-1), determinant[:, None]).reshape(-1, 2, 2)


def _across(edges: np.ndarray, uv_edges: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """(m, 3) each: the direction in which U grows, and the one at right angles on the side where V does."""
    along, aside = edges[:, 0], edges[:, 1]
    tangent, turn = along, np.ones((len(edges), 1), np.float32)
    if uv_edges is not None:
        (u1, v1), (u2, v2) = (np.split(uv_edges[:, i], 2, axis=-1) for i in range(2))
        area = u1 * v2 - u2 * v1
        tangent = np.where(area != 0, (along * v2 - aside * v1) * np.sign(area), along)
        turn = np.where(area != 0, np.sign(area), 1)
    tangent = unit(tangent)
    return tangent, turn * np.cross(unit(np.cross(along, aside)), tangent)


def _frame(edges: np.ndarray, uv_edges: np.ndarray | None, normal: np.ndarray) -> np.ndarray:
    """(m, r, c, 3, 3) rows: tangent, the other tangent, smooth normal (m, r, c, 3)."""
    tangents = [axis[:, None, None] for axis in _across(edges, uv_edges)]
    return np.stack([unit(axis - normal * dot(axis, normal)) for axis in tangents] + [normal], axis=-2)


def bent_normals(bent: np.ndarray, points: Points, corners: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(m, 3) unit normals whose UV-frame normals at points with weights are `bent` (m, 3).

    corners: (m, 3, 3) of their triangles, normal: (m, 3) smooth ones, in the frame of the result.
    """
    frame = _frame(points.ways(corners), points.uv_edges(), normal[:, None, None])
    return unit(_combined(bent, frame[:, 0, 0]))


def _frame_in_world(n: NodeCall) -> np.ndarray:
    if n.points.corners is None:
        raise Unknown("there is no surface whose normal it could change")
    edges = n.points.edges @ np.float32(n.instance().matrix[:3, :3].T)
    return _frame(edges, n.points.uv_edges(), normals_in_world(n, n.points.normal))


def _combined(bent: np.ndarray, frame: np.ndarray) -> np.ndarray:
    return np.einsum("...a,...ab->...b", bent, frame)


FUNCTIONS = {"ShaderNodeBump": bump, "ShaderNodeNormalMap": normal_map}
