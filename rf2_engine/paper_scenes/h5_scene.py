# SPDX-License-Identifier: GPL-3.0-or-later
"""H5 scenes of the research code, as Blender scenes and from them (docs/scene-input.md 8.1, 8.2).

Export needs the latents of published weights. Textures in such a file are codes for the network, which no shader can be
read back from: import brings geometry, lights, cameras and environment, and the homogeneous latents of raw files.
Files of version 1 hold diffuse and specular colours, and become shaders of these.
"""
from __future__ import annotations

import tempfile
from pathlib import Path

import bpy
import numpy as np

from mathutils import Matrix

from ...model.errors import CheckpointError, SceneError
from ...model.published.h5 import read_h5
from ...model.published.obj_mesh import ObjMesh
from ...model.published.prepared_frame import MEASURED, FrameEnvironment, FrameMaterial
from ...model.published.processed_scene import ProcessedScene
from ...model.published.v1_textures import BRDF, V1, fill_tiles
from ...model.scene import RenderScene
from ...model.weights.presets import BUNDLED
from ..convert.camera.camera import convert_camera
from ..convert.data.copied import ConversionOptions
from ..convert.data.report import Report
from ..convert.scene import convert
from ..cycles.world import CyclesWorld
from ..material_settings import COUNT, set_latent
from ..progress.status import Status
from ..setup import importing
from . import frame_import, material_nodes
from .depsgraph import in_render
from .files import write_panorama
from .material_maps import BARE, LAMP

PANORAMA = "env_map.exr"


def export_h5(scene: bpy.types.Scene, weights: str | None, path: Path, report: Report) -> RenderScene:
    """Convert a scene as F12 would and write it with its camera; weights: folder of the published bundle.

    Raises CheckpointError for the weights, SceneError for the scene, OSError as the disk does.
    """
    if weights in (None, BUNDLED):
        raise CheckpointError("H5 scenes hold latents of the published weights: choose those in Render Properties > "
                              "RenderFormer-V2 > Weights, or give their folder with --weights")
    settings = scene.renderformer_v2
    options = ConversionOptions(settings.token_budget, settings.max_edge, settings.as_is, settings.paper_lamps,
                                keeps_lobes=True)

    def convert_scene(engine, depsgraph):
        view = convert_camera(depsgraph, engine.resolution_x, engine.resolution_y, None, report)
        cycles_world = CyclesWorld(engine, depsgraph, Status(engine))
        return convert(depsgraph, view, options, report, cycles_world=cycles_world), view

    converted, view = in_render(scene, convert_scene)
    if not len(converted):
        content = "only volumes" if converted.volumes else "nothing to render"
        raise SceneError(f'scene "{scene.name}" holds {content}: an H5 scene needs at least one triangle, '
                         "add a mesh or a lamp")
    importing.import_packages()
    from ...model.published.h5 import write_h5
    from ...model.published.pipeline import PublishedPipeline
    write_h5(path, PublishedPipeline(weights, "cpu", None).process(converted, [view]))
    return converted


def import_h5(file: Path, report: Report, resolution: int = frame_import.RESOLUTION) -> bpy.types.Scene:
    """Make a new scene beside those of the open file. The report names what cannot become a shader.

    Raises SceneError for a file that is no H5 scene, and without the package h5py; OSError as the disk does.
    """
    scene_file = read_h5(file)
    with frame_import.new_scene(file.stem) as scene:
        _add_surfaces(scene, scene_file, report)
        if scene_file.volumes is not None:
            report.skipped(file.stem, f"its {len(scene_file.volumes)} volume cells: render the file itself with "
                                      "tools.render to see them")
        scene.world = _create_world(file, scene_file)
        for matrix, degrees in zip(scene_file.camera_to_world.astype(np.float64), scene_file.fov):
            frame_import.add_camera(scene, Matrix(matrix.tolist()), float(degrees))
        frame_import.bind_cameras(scene)
        frame_import.set_up_render(scene, resolution, len(scene_file.triangles))
    return scene


def _add_surfaces(scene, scene_file: ProcessedScene, report: Report) -> None:
    """An object for each light and each latent or colour, and one for all other triangles."""
    rows = np.concatenate([scene_file.light_strength, _read_appearance(scene_file, report)], axis=1)
    rows[scene_file.light_strength.any(axis=1), 3:] = 0
    unique_rows, index = np.unique(rows, axis=0, return_inverse=True)
    for i, values in enumerate(unique_rows):
        radiance, latent = values[:3], values[3:]
        material = BARE
        if radiance.any():
            material = FrameMaterial("homo_diffuse_specular", LAMP, emission=tuple(radiance.tolist()))
        elif scene_file.is_v1:
            numbers = {name: latent[V1[name]].tolist() for name in ("diffuse", "specular")}
            material = FrameMaterial("homo_diffuse_specular", numbers | {"roughness": float(latent[-1])})
        elif latent.any():
            material = FrameMaterial(MEASURED, latent="")
        name = "Light" if radiance.any() else "Surface"
        rows = index.reshape(-1) == i
        triangles = _merge_corners(scene_file.triangles[rows], scene_file.normals[rows])
        mesh = frame_import.create_mesh(name, triangles, material)
        shaded = material_nodes.create_material(name, material, Path(), report)
        if material.kind == MEASURED:
            set_latent(shaded, latent)
        mesh.materials.append(shaded)
        obj = bpy.data.objects.new(name, mesh)
        obj.visible_camera = not radiance.any()
        scene.collection.objects.link(obj)


def _read_appearance(scene_file: ProcessedScene, report: Report) -> np.ndarray:
    """The latents (N, 9) f32 of triangles, 0 where the file has none, or parameters (N, 7) of version 1."""
    if not scene_file.is_raw:
        report.approximated("Materials", "the file holds encoded textures, from which no shader can be read back: "
                                         "surfaces are grey")
        return np.zeros((len(scene_file.triangles), COUNT), np.float32)
    tiles = scene_file.texture[scene_file.texture_index, BRDF if scene_file.is_v1 else slice(COUNT)].astype(np.float32)
    tiles = fill_tiles(tiles) if scene_file.is_v1 else tiles
    constant = (tiles == tiles[..., :1, :1]).all(axis=(1, 2, 3))
    if not constant.all():
        report.approximated("Materials", f"{np.count_nonzero(~constant)} triangles have textures: their mean is "
                                         "used")
    return np.clip(tiles.mean(axis=(2, 3)), -1, 1)


def _merge_corners(corners: np.ndarray, normals: np.ndarray) -> ObjMesh:
    vertices, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    faces = index.reshape(-1, 3)
    is_triangle = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    return ObjMesh(vertices, faces[is_triangle].ravel().astype(np.int32), np.full(is_triangle.sum(), 3, np.int32), None,
                   normals[is_triangle].reshape(-1, 3) if normals.any() else None)


def _create_world(file: Path, scene_file: ProcessedScene) -> bpy.types.World:
    """The world, with its panorama packed into the .blend file."""
    if scene_file.environment is None:
        return frame_import.create_world(file.stem, Path(), None)
    with tempfile.TemporaryDirectory() as folder:
        write_panorama(Path(folder) / PANORAMA, scene_file.environment)
        world = frame_import.create_world(file.stem, Path(folder), FrameEnvironment(PANORAMA))
        next(node for node in world.node_tree.nodes if node.bl_idname == "ShaderNodeTexEnvironment").image.pack()
    return world
