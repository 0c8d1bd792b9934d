# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluated Blender meshes as triangle arrays (docs/scene-input.md 2)."""
from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ....model import progress
from ....model.geometry import area_vectors
from .. import attributes
from ..report import AS_GOOD_AS_INFINITE

ROUNDING = 1e-6  # of the length of unit vectors


@dataclass
class TriangleMesh:
    """n triangles with everything that varies per corner, in the frame of the object (Z up, right-handed)."""

    corners: np.ndarray            # (n, 3, 3) f32, [triangle, corner, xyz], counter-clockwise from the front
    normals: np.ndarray            # (n, 3, 3) f32, unit shading normal per corner
    uv: dict[str, np.ndarray]      # layer -> (n, 3, 2) f32
    active_uv: str | None          # the layer that renders where a material names none
    attributes: dict[str, np.ndarray]  # by name (n, 3, c) f32, c from 1 to 4; colours are scene-linear, with alpha
    active_color: str | None       # the one that renders where a material names none
    slot: np.ndarray               # (n,) i32, material slot
    texture_space: np.ndarray      # (2, 3) f32, middle and half size of the box of Generated coordinates
    is_displaced: bool = False         # its materials' displacement is in the corners

    def __len__(self) -> int:
        return len(self.corners)

    @cached_property
    def bounds(self) -> np.ndarray:
        """(2, 3) lowest and highest coordinates."""
        flat = self.corners.reshape(-1, 9)
        return np.stack([flat.min(axis=0).reshape(3, 3).min(axis=0), flat.max(axis=0).reshape(3, 3).max(axis=0)])

    @cached_property
    def area(self) -> float:
        return float(areas(self.corners).sum())

    def take(self, index: np.ndarray) -> TriangleMesh:
        """The triangles picked by an integer or boolean index."""
        return self.mapped(lambda layer: layer[index], slot=self.slot[index])

    def mirrored(self) -> TriangleMesh:
        """The same surface with the corner order reversed, for matrices with a negative determinant."""
        return self.mapped(lambda layer: layer[:, [1, 0, 2]])

    def mapped(self, function, **changes) -> TriangleMesh:
        """This mesh with `function` applied to every array that varies per corner."""
        return replace(self, corners=function(self.corners), normals=function(self.normals),
                       uv={name: function(layer) for name, layer in self.uv.items()},
                       attributes={name: function(layer) for name, layer in self.attributes.items()}, **changes)


def read_mesh(mesh, name: str, report, asked=()) -> TriangleMesh:
    """Copy an evaluated `bpy.types.Mesh`; `name` is the object that the report mentions.

    asked: names of attributes that materials ask for, besides colours.

    Triangles with corners that are not finite, without area, or with the corners of another are left out and reported.
    """
    progress.report()
    mesh.calc_loop_triangles()
    count = len(mesh.loop_triangles)
    loop = _read(mesh.loop_triangles, "loops", 3 * count, np.int32).reshape(count, 3)
    progress.report()
    # These are copied at one go; triangles are asked one by one, which takes many times as long.
    polygon = _read(mesh.loop_triangle_polygons, "value", count, np.int32)
    vertex = _read(mesh.attributes[".corner_vert"].data, "value", len(mesh.loops), np.int32)[loop] if count else loop
    slot = np.zeros(count, np.int32)
    if "material_index" in mesh.attributes:
        slot = _read(mesh.loop_triangles, "material_index", count, np.int32)
    progress.report()
    position = _read(mesh.vertices, "co", 3 * len(mesh.vertices)).reshape(-1, 3)
    normal = _read(mesh.corner_normals, "vector", 3 * len(mesh.loops)).reshape(-1, 3)
    uv = {layer.name: _read(layer.uv, "vector", 2 * len(mesh.loops)).reshape(-1, 2)[loop] for layer in mesh.uv_layers}
    active = next((layer.name for layer in mesh.uv_layers if layer.active_render), None)
    named = attributes.of_mesh(mesh, asked, loop, vertex, polygon)
    progress.report()
    space = np.float32([mesh.texspace_location, mesh.texspace_size])
    triangles = TriangleMesh(position[vertex], normal[loop], uv, active, named, _render_color(mesh), slot, space)
    return _without_broken(triangles, name, report)


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


def transform(mesh: TriangleMesh, matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """World-space (n, 3, 3) f32 corners and unit normals of a mesh under a (4, 4) matrix.

    A mesh under a matrix with a negative determinant must have been `mirrored` before.
    """
    linear = matrix[:3, :3].astype(np.float64)
    corners = mesh.corners @ linear.T + matrix[:3, 3]
    a, b, c = linear.T
    # Columns of the cofactor matrix: the inverse transpose that also exists for a flattened object.
    cofactor = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
    if np.linalg.det(linear) < 0:
        cofactor = -cofactor
    normals = mesh.normals @ cofactor.T
    return corners.astype(np.float32), unit_or(normals, face_normals(corners)[:, None])


def face_normals(corners: np.ndarray) -> np.ndarray:
    """(n, 3) unit normals of (n, 3, 3) corners; 0 for triangles without area."""
    normals = area_vectors(corners.astype(np.float64))
    return normals / np.maximum(lengths(normals)[:, None], 1e-300)


def lengths(vectors: np.ndarray) -> np.ndarray:
    """(...) of (..., 3) vectors; numpy's own norm takes four times as long."""
    return np.sqrt(np.einsum("...i,...i->...", vectors, vectors))


def middles(corners: np.ndarray) -> np.ndarray:
    """(n, 3) centroids of (n, 3, 3) corners."""
    return (corners[:, 0] + corners[:, 1] + corners[:, 2]) / 3


def areas(corners: np.ndarray) -> np.ndarray:
    """(n,) f64 areas of (n, 3, 3) corners."""
    return lengths(area_vectors(corners.astype(np.float64)))


def within_reach(corners: np.ndarray) -> np.ndarray:
    """(n,) bool: no coordinate of the triangle is NaN, or infinite, or as good as that."""
    return (np.abs(corners) < AS_GOOD_AS_INFINITE).all(axis=(1, 2))


def has_area(corners: np.ndarray) -> np.ndarray:
    """(n,) bool: the triangle is not a line or a point at the precision of its own coordinates."""
    longest = np.square(longest_edges(corners))
    extent = np.abs(corners).max(axis=(1, 2)).astype(np.float64)
    return (areas(corners) > 1e-7 * longest) & (longest > np.square(1e-7 * extent)) & (longest > 1e-30)


def longest_edges(corners: np.ndarray) -> np.ndarray:
    """(n,) f64 length of the longest edge of each triangle."""
    a, b, c = corners.astype(np.float64).swapaxes(0, 1)
    return np.maximum(np.maximum(lengths(b - a), lengths(c - b)), lengths(a - c))


def unit_or(vectors: np.ndarray, fallback: np.ndarray) -> np.ndarray:
    """`vectors` normalised along the last axis as f32; `fallback` where they are 0 or not finite."""
    vectors = vectors.astype(np.float64)
    length = lengths(vectors)[..., None]
    usable = np.isfinite(length) & (length > 1e-12 * np.nanmax(length, initial=1e-300))
    return np.where(usable, vectors / np.where(usable, length, 1), fallback).astype(np.float32)


def _without_broken(mesh: TriangleMesh, name: str, report) -> TriangleMesh:
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
    first = _first_of_its_place(mesh.corners)
    if len(first) < len(mesh):
        report.approximated(name, f"{len(mesh) - len(first)} triangles were removed as duplicates")
        mesh = mesh.take(first)
    progress.report()
    if not (np.abs(lengths(mesh.normals) - 1) < ROUNDING).all():
        mesh = replace(mesh, normals=unit_or(mesh.normals, face_normals(mesh.corners)[:, None]))
    progress.report()
    return mesh.mapped(lambda layer: layer if np.isfinite(layer).all() else np.nan_to_num(layer, posinf=0, neginf=0))


def _first_of_its_place(corners: np.ndarray) -> np.ndarray:
    """Indices, in order, of all triangles but those with the same three corners as one before."""
    one = corner_keys(corners) @ np.ones(3, np.uint64)  # whatever the order of the corners
    if np.diff(np.sort(one)).all():
        return np.arange(len(one))
    return np.sort(np.unique(one, return_index=True)[1])


def corner_keys(corners: np.ndarray) -> np.ndarray:
    """(n, 3) u64 of (n, 3, 3) f32 corners, alike for equal coordinates, and for no others by any likely chance."""
    bits = np.ascontiguousarray(corners.astype(np.float32) + np.float32(0)).view(np.uint32)  # -0 and 0 are one
    key = np.zeros(bits.shape[:2], np.uint64)
    for axis in range(3):  # round coordinates differ in few bits, so these are mixed well (Steele et al. 2014)
        key = (key + bits[..., axis]) * np.uint64(0x9E3779B97F4A7C15)
        key = (key ^ key >> np.uint64(30)) * np.uint64(0xBF58476D1CE4E5B9)
        key = (key ^ key >> np.uint64(27)) * np.uint64(0x94D049BB133111EB)
        key ^= key >> np.uint64(31)
    return key


def _render_color(mesh) -> str | None:
    index, layers = mesh.color_attributes.render_color_index, mesh.color_attributes
    return layers[index].name if 0 <= index < len(layers) else None


def _read(collection, attribute: str, size: int, dtype=np.float32) -> np.ndarray:
    values = np.empty(size, dtype)
    collection.foreach_get(attribute, values)
    return values
