# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes of generated objects: modifiers applied, size, UVs, smooth or flat (docs/scene-input.md 2.2)."""
from __future__ import annotations

import bpy
import numpy as np

SMOOTH_ANGLE = np.radians(30.0)


def evaluated_mesh(source: bpy.types.Object) -> bpy.types.Mesh:
    depsgraph = bpy.context.evaluated_depsgraph_get()
    return bpy.data.meshes.new_from_object(source.evaluated_get(depsgraph), depsgraph=depsgraph)


def coordinates(mesh: bpy.types.Mesh) -> np.ndarray:
    points = np.empty(len(mesh.vertices) * 3, np.float32)
    mesh.vertices.foreach_get("co", points)
    return points.reshape(-1, 3)


def fit(rng: np.random.Generator, mesh: bpy.types.Mesh) -> None:
    points = coordinates(mesh)
    points = (points - points.mean(axis=0)) * (rng.uniform(0.6, 1.4, 3) if rng.uniform() < 0.5 else 1.0)
    points *= 0.5 / np.linalg.norm(points, axis=1).max()
    mesh.vertices.foreach_set("co", points.astype(np.float32).ravel())
    mesh.update()


def box_uv(mesh: bpy.types.Mesh) -> None:
    """Each face takes the two coordinates across its dominant axis as UV, as Blender's cube projection does."""
    corners, points = np.empty(len(mesh.loops), np.int32), coordinates(mesh)
    mesh.loops.foreach_get("vertex_index", corners)
    normals = np.array([p.normal for p in mesh.polygons])
    axis = np.abs(normals).argmax(axis=1).repeat([p.loop_total for p in mesh.polygons])
    across = np.array([[1, 2], [0, 2], [0, 1]])[axis]
    uv = np.take_along_axis(points[corners], across, axis=1) + 0.5
    while mesh.uv_layers:
        mesh.uv_layers.remove(mesh.uv_layers[0])
    mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", uv.astype(np.float32).ravel())


def shading(rng: np.random.Generator, mesh: bpy.types.Mesh) -> None:
    """Half flat, a quarter smooth, a quarter smooth with edges sharper than 30 degrees kept."""
    style = rng.uniform()
    mesh.polygons.foreach_set("use_smooth", np.full(len(mesh.polygons), style >= 0.5))
    if style >= 0.75:
        mesh.set_sharp_from_angle(angle=SMOOTH_ANGLE)
    mesh.update()
