# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes of generated objects: modifiers applied, size, UVs, smooth or flat (docs/scene-input.md 2.2)."""
from __future__ import annotations

import bpy
import numpy as np

SMOOTH_ANGLE = np.radians(30.0)


def add_object(name: str, data: bpy.types.ID) -> bpy.types.Object:
    """An object of a mesh, lamp or camera in the open scene."""
    added = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(added)
    return added


def make_box(name: str, low: np.ndarray, high: np.ndarray) -> bpy.types.Mesh:
    """A closed box between two corners, its faces outwards."""
    mesh = bpy.data.meshes.new(name)
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)])
    mesh.from_pydata(low + corners * (high - low), [], [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3),
                                                        (0, 4, 6, 2), (1, 3, 7, 5)])
    return mesh


def apply_modifiers(source: bpy.types.Object) -> bpy.types.Mesh:
    """A new mesh of an object of the open scene."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    return bpy.data.meshes.new_from_object(source.evaluated_get(depsgraph), depsgraph=depsgraph)


def subdivide(rng: np.random.Generator, mesh: bpy.types.Mesh, levels: int) -> bpy.types.Mesh:
    """About 4^levels times the faces, rounded or of the same shape."""
    source = add_object("subdivided", mesh)
    modifier = source.modifiers.new("subdivision", "SUBSURF")
    modifier.levels, modifier.subdivision_type = levels, str(rng.choice(["SIMPLE", "CATMULL_CLARK"]))
    fine = apply_modifiers(source)
    bpy.data.objects.remove(source)
    return fine


def read_vertices(mesh: bpy.types.Mesh) -> np.ndarray:
    """(N, 3) f32."""
    points = np.empty(len(mesh.vertices) * 3, np.float32)
    mesh.vertices.foreach_get("co", points)
    return points.reshape(-1, 3)


def center_and_scale(rng: np.random.Generator, mesh: bpy.types.Mesh) -> None:
    """Move a mesh to the origin and its farthest vertex to a distance of 0.5, by chance stretched along its axes."""
    points = read_vertices(mesh)
    points = (points - points.mean(axis=0)) * (rng.uniform(0.6, 1.4, 3) if rng.uniform() < 0.5 else 1.0)
    points *= 0.5 / np.linalg.norm(points, axis=1).max()
    mesh.vertices.foreach_set("co", points.astype(np.float32).ravel())
    mesh.update()


def set_box_uv(mesh: bpy.types.Mesh) -> None:
    """Each face takes the two coordinates across its dominant axis as UV, as Blender's cube projection does."""
    corners, points = np.empty(len(mesh.loops), np.int32), read_vertices(mesh)
    mesh.loops.foreach_get("vertex_index", corners)
    normals = np.array([p.normal for p in mesh.polygons])
    axis = np.abs(normals).argmax(axis=1).repeat([p.loop_total for p in mesh.polygons])
    across = np.array([[1, 2], [0, 2], [0, 1]])[axis]
    uv = np.take_along_axis(points[corners], across, axis=1) + 0.5
    while mesh.uv_layers:
        mesh.uv_layers.remove(mesh.uv_layers[0])
    mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", uv.astype(np.float32).ravel())


def set_shading(rng: np.random.Generator, mesh: bpy.types.Mesh) -> None:
    """Half flat, a quarter smooth, a quarter smooth but for edges sharper than 30 degrees."""
    style = rng.uniform()
    mesh.polygons.foreach_set("use_smooth", np.full(len(mesh.polygons), style >= 0.5))
    if style >= 0.75:
        mesh.set_sharp_from_angle(angle=SMOOTH_ANGLE)
    mesh.update()
