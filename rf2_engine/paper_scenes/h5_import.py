# SPDX-License-Identifier: GPL-3.0-or-later
"""An H5 scene of the research code as a Blender scene (docs/scene-input.md 8.1, 8.2).

Textures in such a file are codes for the network, from which no shader can be read back. So geometry, lights, cameras
and environment come in, and homogeneous latents of raw files.
"""
from __future__ import annotations

import tempfile
from pathlib import Path

import bpy
import numpy as np

from mathutils import Matrix

from ...model.published.h5 import read_h5
from ...model.published.obj_mesh import ObjMesh
from ...model.published.prepared_frame import MEASURED, FrameEnvironment, FrameMaterial
from ...model.published.processed_scene import ProcessedScene
from ..material_settings import COUNT, set_latent
from . import importing, material_nodes
from .material_maps import BARE, LAMP
from .panorama import write_panorama

PANORAMA = "env_map.exr"


def import_h5(file: Path, report, resolution: int = importing.RESOLUTION) -> bpy.types.Scene:
    """A new scene beside those of the open file. What the file has no shader for is in the report.

    Raises SceneError for a file that is no such scene, and without the package h5py; OSError as the disk does.
    """
    found = read_h5(file)
    scene = bpy.data.scenes.new(file.stem)
    try:
        _add_surfaces(scene, found, report)
        if found.volumes is not None:
            report.skipped(file.stem, f"its {len(found.volumes)} volume cells: render the file itself with "
                                      "tools.render to see them")
        scene.world = _world(file, found)
        for matrix, degrees in zip(found.camera_to_world.astype(np.float64), found.fov):
            importing.add_camera(scene, Matrix(matrix.tolist()), float(degrees))
        importing.bind_cameras(scene)
        importing.settle(scene, resolution, len(found.triangles))
    except BaseException:
        bpy.data.scenes.remove(scene)
        raise
    return scene


def _add_surfaces(scene, found: ProcessedScene, report) -> None:
    """An object for each light and each latent, one for all that has none."""
    look = np.concatenate([found.light_strength, _latents(found, report)], axis=1)
    look[found.light_strength.any(axis=1), 3:] = 0
    kinds, which = np.unique(look, axis=0, return_inverse=True)
    for i, values in enumerate(kinds):
        radiance, latent = values[:3], values[3:]
        material = BARE
        if radiance.any():
            material = FrameMaterial("homo_diffuse_specular", LAMP, emission=tuple(radiance.tolist()))
        elif latent.any():
            material = FrameMaterial(MEASURED, latent="")
        name = "Light" if radiance.any() else "Surface"
        rows = which.reshape(-1) == i
        mesh = importing.mesh_of(name, _joined(found.triangles[rows], found.normals[rows]), material)
        made = material_nodes.build(name, material, Path(), report)
        if latent.any() and not radiance.any():
            set_latent(made, latent)
        mesh.materials.append(made)
        added = bpy.data.objects.new(name, mesh)
        added.visible_camera = not radiance.any()
        scene.collection.objects.link(added)


def _latents(found: ProcessedScene, report) -> np.ndarray:
    """(N, 9) f32, 0 where the file does not tell."""
    none = np.zeros((len(found.triangles), COUNT), np.float32)
    if not found.is_raw:
        report.approximated("Materials", "the file holds encoded textures, from which no shader can be read back: "
                                         "surfaces are grey")
        return none
    tiles = found.texture[found.texture_index, :COUNT].astype(np.float32)
    constant = (tiles == tiles[..., :1, :1]).all(axis=(1, 2, 3))
    if not constant.all():
        report.approximated("Materials", f"{np.count_nonzero(~constant)} triangles have textures of latents: their "
                                         "mean is used")
    return np.clip(tiles.mean(axis=(2, 3)), -1, 1)


def _joined(corners: np.ndarray, normals: np.ndarray) -> ObjMesh:
    vertices, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    faces = index.reshape(-1, 3)
    kept = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    return ObjMesh(vertices, faces[kept].ravel().astype(np.int32), np.full(kept.sum(), 3, np.int32), None,
                   normals[kept].reshape(-1, 3) if normals.any() else None)


def _world(file: Path, found: ProcessedScene) -> bpy.types.World:
    """The panorama is packed into the .blend file."""
    if found.environment is None:
        return importing.world(file.stem, Path(), None)
    with tempfile.TemporaryDirectory() as folder:
        write_panorama(Path(folder) / PANORAMA, found.environment)
        world = importing.world(file.stem, Path(folder), FrameEnvironment(PANORAMA))
        next(node for node in world.node_tree.nodes if node.bl_idname == "ShaderNodeTexEnvironment").image.pack()
    return world
