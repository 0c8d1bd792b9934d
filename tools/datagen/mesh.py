# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes of generated objects: modifiers applied, size, UVs, smooth or flat (docs/scene-input.md 2.2)."""
from __future__ import annotations

import bpy
import numpy as np

SMOOTH_ANGLE = np.radians(30.0)


def box(name: str, low: np.ndarray, high: np.ndarray) -> bpy.types.Mesh:
    """A closed box between two corners, its faces outwards."""
    mesh = bpy.data.meshes.new(name)
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)])
    mesh.from_pydata(low + corners * (high - low), [], [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3),
                                                        (0, 4, 6, 2), (1, 3, 7, 5)])
    return mesh


def evaluated_mesh(source: bpy.types.Object) -> bpy.types.Mesh:
    depsgraph = bpy.context.evaluated_depsgraph_get()
    return bpy.data.meshes.new_from_object(source.evaluated_get(depsgraph), depsgraph=depsgraph)


def subdivided(rng: np.random.Generator, mesh: bpy.types.Mesh, levels: int) -> bpy.types.Mesh:
    """About 4^levels times the faces, rounded or of the same shape."""
    source = bpy.data.objects.new("subdivided", mesh)
    bpy.context.scene.collection.objects.link(source)
    modifier = source.modifiers.new("subdivision", "SUBSURF")
    modifier.levels, modifier.subdivision_type = levels, str(rng.choice(["SIMPLE", "CATMULL_CLARK"]))
    fine = evaluated_mesh(source)
    bpy.data.objects.remove(source)
    return fine


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
