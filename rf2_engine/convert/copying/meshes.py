# SPDX-License-Identifier: GPL-3.0-or-later
"""Read evaluated Blender meshes and their material slots (docs/scene-input.md 2)."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from ....model import progress
from ... import compat
from ..data.mesh import TriangleMesh, corner_keys, face_normals, has_area, lengths, unit_or, within_reach
from ..data.report import Report
from .attributes import read_attributes, read_values

ROUNDING = 1e-6  # of the length of unit vectors


def read_mesh(mesh, name: str, report: Report, requested=()) -> TriangleMesh:
    """Copy an evaluated `bpy.types.Mesh`; `name` is the object that the report mentions.

    requested: names of attributes that materials read, besides colours.
    Triangles with corners that are not finite, without area, or with the corners of another are left out and reported.
    """
    progress.report()
    mesh.calc_loop_triangles()
    loop = read_values(mesh.loop_triangles, "loops", (3,), np.int32)
    progress.report()
    polygon = read_values(mesh.loop_triangle_polygons, "value", dtype=np.int32)
    corner = read_values(mesh.attributes[".corner_vert"].data, "value", dtype=np.int32) if len(loop) else np.int32([])
    vertex = corner[loop]
    slot = np.zeros(len(loop), np.int32)
    if "material_index" in mesh.attributes:
        slot = read_values(mesh.loop_triangles, "material_index", dtype=np.int32)
    progress.report()
    position = read_values(mesh.vertices, "co", (3,))
    normal = _normals(mesh, corner, loop, polygon)
    uv = {layer.name: read_values(layer.uv, "vector", (2,))[loop] for layer in mesh.uv_layers}
    active = next((layer.name for layer in mesh.uv_layers if layer.active_render), None)
    named = read_attributes(mesh, requested, loop, vertex, polygon)
    progress.report()
    space = np.float32([mesh.texspace_location, mesh.texspace_size])
    triangles = TriangleMesh(position[vertex], normal, uv, active, named, _render_color(mesh), slot, space)
    return _without_broken(triangles, name, report)


def _normals(mesh, corner: np.ndarray, loop: np.ndarray, polygon: np.ndarray) -> np.ndarray:
    """(n, 3, 3) of triangles with corners `loop` (n, 3) of faces `polygon` (n,), as Cycles shades them.

    corner: (loops,) vertices. Blender lets smooth shading end at flat faces; in Cycles of older versions it does so
    only where there are sharp edges or custom normals too.
    """
    normal = read_values(mesh.corner_normals, "vector", (3,))[loop]
    if not compat.smooths_past_flat_faces():
        return normal
    edges, faces = (_flags(mesh, name) for name in ("sharp_edge", "sharp_face"))
    if mesh.has_custom_normals or edges.any() or not faces.any() or faces.all():
        return normal
    of_vertices = read_values(mesh.vertex_normals, "vector", (3,))
    return np.where(faces[polygon][:, None, None], normal, of_vertices[corner[loop]])


def _flags(mesh, name: str) -> np.ndarray:
    """Values of a boolean attribute; none if the mesh has no such attribute."""
    attribute = mesh.attributes.get(name)
    return np.zeros(0, bool) if attribute is None else read_values(attribute.data, "value", dtype=bool)


def material_slots(obj) -> list:
    """The evaluated materials (or None) of an object by material index, slots linked to the object included."""
    on_mesh, on_object = list(obj.data.materials), list(obj.material_slots)
    slots = []
    for i in range(max(len(on_mesh), len(on_object), 1)):
        material = on_mesh[i] if i < len(on_mesh) else None
        if i < len(on_object) and (material is None or on_object[i].link == "OBJECT"):
            material = on_object[i].material
        slots.append(material)
    return slots


def _without_broken(mesh: TriangleMesh, name: str, report: Report) -> TriangleMesh:
    finite = within_reach(mesh.corners)
    if not finite.all():
        report.refused(name, f"{np.count_nonzero(~finite)} triangles with infinite or invalid vertices were removed")
        mesh = mesh.take(finite)
    progress.report()
    solid = has_area(mesh.corners)
    if not solid.all():
        report.refused(name, f"{np.count_nonzero(~solid)} triangles without area were removed")
        mesh = mesh.take(solid)
    progress.report()
    first = _without_duplicates(mesh.corners)
    if len(first) < len(mesh):
        report.approximated(name, f"{len(mesh) - len(first)} triangles were removed as duplicates")
        mesh = mesh.take(first)
    progress.report()
    if not (np.abs(lengths(mesh.normals) - 1) < ROUNDING).all():
        mesh = replace(mesh, normals=unit_or(mesh.normals, face_normals(mesh.corners)[:, None]))
    progress.report()
    return mesh.mapped(lambda layer: layer if np.isfinite(layer).all() else np.nan_to_num(layer, posinf=0, neginf=0))


def _without_duplicates(corners: np.ndarray) -> np.ndarray:
    """Indices, in order, of the triangles that do not have the same three corners as an earlier one."""
    one = corner_keys(corners) @ np.ones(3, np.uint64)  # whatever the order of the corners
    if np.diff(np.sort(one)).all():
        return np.arange(len(one))
    return np.sort(np.unique(one, return_index=True)[1])


def _render_color(mesh) -> str | None:
    index, layers = mesh.color_attributes.render_color_index, mesh.color_attributes
    return layers[index].name if 0 <= index < len(layers) else None
