# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes of RenderFormer, the first version (a JSON file beside its meshes), as prepared frames of the second.

What differs: meshes have a transform, all materials are diffuse and specular, there is no environment and no volume,
and an object may have a random diffuse colour for each triangle or each smooth part of its surface.
"""
from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from ..errors import SceneError
from ..geometry import area_vectors, pieces
from .entries import read_json_file
from .obj_mesh import ObjMesh, read_obj, write_obj
from .png_file import write_png
from .prepared_frame import MESHES, FrameEntry, FrameMaterial, FrameObject, PreparedFrame, write_frame

SMOOTH = math.cos(math.radians(30))  # of the largest angle between faces of a smooth part
KIND, TEXTURED = "homo_diffuse_specular", "svbrdf_diffuse_specular"
SIDE = 256  # texels of a map; each is a colour
FLAT = 128, 128, 255  # of a normal map


def convert_v1_scene(file: Path, folder: Path) -> list[str]:
    """Write the prepared frame of a scene of version 1 into a new or empty folder; sentences say what is left out.

    Raises SceneError naming what is wrong in the file or in a mesh, FileNotFoundError where one is missing, OSError as
    the disk does.
    """
    entry = read_json_file(file, _V1Entry)
    objects, remarks = {}, []
    (folder / MESHES).mkdir(parents=True, exist_ok=True)
    for key, source in entry["objects"].named():
        mesh = source["transform"].moved(_triangulated(read_obj(file.parent / source["mesh_path"].path())))
        material, colors = source["material"].v1_material(mesh)
        if source["remesh"].flag():
            remarks.append(f"{key}: its remesh is left out, its triangles are those of the file")
        name, uv = f"{MESHES}/{key}.obj", None
        if colors is not None:
            material.kind, material.folder = TEXTURED, f"{MESHES}/{key}"
            uv = _write_maps(folder / material.folder, colors, material.numbers)
        write_obj(folder / name, mesh, None, uv)
        objects[key] = FrameObject(name, material, is_background=key.startswith("background"),
                                   is_light=any(material.emission))
    frame = PreparedFrame(entry["scene_name"].text(default=file.stem), objects,
                          [camera.camera() for camera in entry["cameras"].items()])
    if not objects:
        raise SceneError(f"{file}: the scene has no objects")
    write_frame(frame, folder)
    return remarks


class _V1Entry(FrameEntry):
    def moved(self, corners: np.ndarray) -> np.ndarray:
        """(n, 3, 3) corners where the transform of an object puts them."""
        if self["normalize"].flag(True):
            vertices = np.unique(corners.reshape(-1, 3), axis=0)
            center = vertices.mean(axis=0)
            corners = (corners - center) / (2 * np.linalg.norm(vertices - center, axis=1).max(initial=1e-12))
        matrix = np.eye(3)
        for axis, degrees in enumerate(self["rotation"].numbers(3)):
            matrix = _turn(axis, math.radians(degrees)) @ matrix
        return (corners @ matrix.T * self["scale"].numbers(3) + self["translation"].numbers(3)).astype(np.float32)

    def v1_material(self, corners: np.ndarray) -> tuple[FrameMaterial, np.ndarray | None]:
        """The material, and where it has random colours those of all triangles, (n, 3) u8."""
        numbers = {"diffuse": self["diffuse"].numbers(3), "specular": self["specular"].numbers(3),
                   "roughness": self["roughness"].numbers(1)}
        material = FrameMaterial(KIND, numbers, emission=self.emission(), is_smooth=self["smooth_shading"].flag(True))
        if self["rand_tri_diffuse_seed"].value is None:
            return material, None
        alone = self["random_diffuse_type"].text("per-shading-group") == "per-triangle"
        group = np.arange(len(corners)) if alone or not material.is_smooth else find_smooth_parts(corners)
        random = np.random.RandomState(int(self["rand_tri_diffuse_seed"].numbers(1)))
        most = math.ceil(256 * self["random_diffuse_max"].numbers(1, 1.0))
        return material, random.randint(0, max(most, 1), (group.max(initial=-1) + 1, 3))[group].astype(np.uint8)


def find_smooth_parts(corners: np.ndarray) -> np.ndarray:
    """(n,) i64: number of the part of each triangle (n, 3, 3); parts end where faces meet at more than 30 degrees."""
    normals = area_vectors(corners.astype(np.float64))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True).clip(1e-30)
    vertex = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)[1].reshape(-1, 3)
    edges = np.sort(np.stack([vertex, np.roll(vertex, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T)
    same = (edges[order[1:]] == edges[order[:-1]]).all(axis=1)
    pairs = np.stack([order[1:], order[:-1]], axis=1)[same] // 3
    smooth = (normals[pairs[:, 0]] * normals[pairs[:, 1]]).sum(axis=1) >= SMOOTH
    return pieces(pairs[smooth], len(corners))


def _triangulated(mesh: ObjMesh) -> np.ndarray:
    """(n, 3, 3) f32 corners; a polygon becomes a fan around its first corner."""
    first = np.concatenate([[0], mesh.sizes.cumsum()[:-1]]).astype(int) if len(mesh.sizes) else np.zeros(0, int)
    face = np.repeat(np.arange(len(mesh.sizes)), mesh.sizes - 2)
    step = np.arange(len(face)) - np.repeat(np.cumsum(mesh.sizes - 2) - (mesh.sizes - 2), mesh.sizes - 2)
    rows = first[face, None] + np.stack([0 * step, step + 1, step + 2], axis=1)
    return mesh.vertices[mesh.corner_vertex[rows]]


def _turn(axis: int, angle: float) -> np.ndarray:
    """(3, 3) rotation about a coordinate axis."""
    matrix, (a, b) = np.eye(3), ((axis + 1) % 3, (axis + 2) % 3)
    matrix[a, a] = matrix[b, b] = math.cos(angle)
    matrix[b, a], matrix[a, b] = math.sin(angle), -math.sin(angle)
    return matrix


def _write_maps(folder: Path, colors: np.ndarray, numbers: dict) -> np.ndarray:
    """Maps of which each triangle shows one texel, the colour of (n, 3) u8; returns its UVs (n, 3, 2)."""
    distinct, texel = np.unique(colors, axis=0, return_inverse=True)
    if len(distinct) > SIDE * SIDE:
        raise SceneError(f"{folder}: more than {SIDE * SIDE} random colours do not fit into a map")
    row, column = np.divmod(texel.reshape(-1), SIDE)
    diffuse = np.zeros((SIDE * SIDE, 3), np.uint8)
    diffuse[:len(distinct)] = distinct
    folder.mkdir()
    constant = {"specular": numbers["specular"], "roughness": [numbers["roughness"]] * 3}
    maps = {name: np.broadcast_to(np.uint8(np.clip(values, 0, 1) * np.float64(255) + 0.5), (SIDE, SIDE, 3))
            for name, values in constant.items()}
    maps |= {"diffuse": diffuse.reshape(SIDE, SIDE, 3), "normal": np.broadcast_to(np.uint8(FLAT), (SIDE, SIDE, 3))}
    for name, pixels in maps.items():
        write_png(folder / f"{name}.png", pixels)
    uv = np.stack([(column + 0.5) / SIDE, 1 - (row + 0.5) / SIDE], axis=1)
    return np.repeat(uv[:, None], 3, axis=1)
