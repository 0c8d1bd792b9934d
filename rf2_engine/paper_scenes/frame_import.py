# SPDX-License-Identifier: GPL-3.0-or-later
"""A prepared frame of the research code as a Blender scene (docs/scene-input.md 8.4, 10)."""
from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np

from mathutils import Matrix, Vector

from ...model.errors import SceneError
from ...model.published.obj_mesh import ObjMesh, read_obj
from ...model.published.prepared_frame import (
    FrameCamera,
    FrameEnvironment,
    FrameMaterial,
    FrameObject,
    FrameVolume,
    find_lfs_pointers,
    find_missing_files,
    read_frame,
)
from ...model.weights.files import lfs_remedy
from ..convert.data.report import Report
from ..engine import RenderFormerEngine
from . import material_nodes

SMOOTH = math.radians(30)  # largest angle between smooth faces, where the file has no normals
RESOLUTION = 512


def import_frame(folder: Path, report: Report, resolution: int = RESOLUTION) -> bpy.types.Scene:
    """Make a new scene beside those of the open file, whose F12 shows the frame in `resolution` x `resolution` pixels.

    What is missing or cannot be used is left out and in the report.
    Raises SceneError for a folder that is no frame, and for one that shows nothing.
    """
    folder = Path(folder).resolve()
    frame = read_frame(folder)
    for name in find_missing_files(frame, folder):
        report.skipped(frame.name, f"{name} is not in {folder}: put it there and import again")
    for name in find_lfs_pointers(frame, folder):
        report.skipped(frame.name, f"{name} {lfs_remedy(folder)}, and import again")
    for key in frame.wall_holes:
        report.skipped(key, "its wall_holes: a hole must be in the mesh itself")
    meshes = {key: _read_mesh(folder / obj.mesh, report) for key, obj in frame.objects.items()}
    if not frame.cameras:
        raise SceneError(f"{folder} has no camera: add one to its scene_config.json")
    with new_scene(frame.name) as scene:
        for key, obj in frame.objects.items():
            if meshes[key] is not None:
                _add_object(scene, key, obj, meshes[key], folder, report)
        for i, volume in enumerate(frame.volumes):
            _add_volume(scene, f"Volume {i + 1}", volume, folder)
        scene.world = create_world(frame.name, folder, frame.environment)
        add_cameras(scene, frame.cameras)
        set_up_render(scene, resolution, sum(int((mesh.sizes - 2).sum()) for mesh in meshes.values() if mesh))
    return scene


@contextmanager
def new_scene(name: str) -> Iterator[bpy.types.Scene]:
    """A scene to be filled inside; it is removed again if that fails."""
    scene = bpy.data.scenes.new(name)
    try:
        yield scene
    except BaseException:
        bpy.data.scenes.remove(scene)
        raise


def set_up_render(scene: bpy.types.Scene, resolution: int, triangles: int) -> None:
    """Square pictures without background by our engine, with triangles, light and scale unchanged."""
    scene.render.engine = RenderFormerEngine.bl_idname
    scene.render.resolution_x = scene.render.resolution_y = resolution
    scene.render.resolution_percentage = 100
    scene.render.film_transparent = True
    scene.view_settings.view_transform = "Standard"
    settings = scene.renderformer_v2
    settings.as_is, settings.max_edge, settings.token_budget = True, 1, max(triangles, 256)


def _read_mesh(file: Path, report: Report) -> ObjMesh | None:
    if not file.is_file():
        return None  # reported already
    try:
        mesh = read_obj(file)
    except SceneError as error:
        report.refused(file.name, str(error))
        return None
    if not len(mesh.sizes):
        report.skipped(file.name, f"{file} has no face that has an area")
    return mesh


def _add_object(scene, key: str, source: FrameObject, obj_mesh: ObjMesh, folder: Path, report: Report) -> None:
    mesh = create_mesh(key, obj_mesh, source.material)
    mesh.materials.append(material_nodes.create_material(key, source.material, folder, report))
    if source.material.diffuse_seed is not None:
        report.approximated(key, "its rand_tri_diffuse_seed: it has its own colour everywhere, as the network of the "
                                 "authors' code is told, not random ones")
    obj = bpy.data.objects.new(key, mesh)
    obj.visible_camera = not any(source.material.emission)  # no picture of the training shows a lamp
    scene.collection.objects.link(obj)


def create_mesh(name: str, obj: ObjMesh, material: FrameMaterial) -> bpy.types.Mesh:
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(obj.vertices))
    mesh.vertices.foreach_set("co", obj.vertices.ravel())
    mesh.loops.add(len(obj.corner_vertex))
    mesh.loops.foreach_set("vertex_index", obj.corner_vertex)
    mesh.polygons.add(len(obj.sizes))
    mesh.polygons.foreach_set("loop_start", np.concatenate([[0], obj.sizes.cumsum()[:-1]]).astype(np.int32)
                              if len(obj.sizes) else obj.sizes)
    mesh.update(calc_edges=True)
    if obj.uv is not None:
        mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", obj.uv.ravel())
    if obj.normals is not None:
        mesh.shade_smooth()
        mesh.normals_split_custom_set(obj.normals)
    elif material.is_smooth:
        mesh.shade_smooth()
        mesh.set_sharp_from_angle(angle=SMOOTH)
    return mesh


def _add_volume(scene, name: str, source: FrameVolume, folder: Path) -> None:
    if not (folder / source.grid).is_file():
        return
    volume = bpy.data.volumes.new(name)
    volume.filepath = str(folder / source.grid)
    volume.materials.append(material_nodes.create_medium(name, source.scattering, source.absorption))
    obj = bpy.data.objects.new(name, volume)
    obj.location, obj.scale = source.translation, source.scale
    obj.rotation_euler = np.radians(source.rotation)
    scene.collection.objects.link(obj)


def create_world(name: str, folder: Path, environment: FrameEnvironment | None) -> bpy.types.World:
    """A world with the panorama; black without one."""
    world = bpy.data.worlds.new(name)
    world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    nodes.clear()
    output, background = nodes.new("ShaderNodeOutputWorld"), nodes.new("ShaderNodeBackground")
    links.new(background.outputs[0], output.inputs["Surface"])
    background.inputs["Color"].default_value = (0, 0, 0, 1)
    if environment is None or not (folder / environment.image).is_file():
        background.inputs["Strength"].default_value = 0
        return world
    coordinates, mapping, texture = map(nodes.new, (
        "ShaderNodeTexCoord", "ShaderNodeMapping", "ShaderNodeTexEnvironment"))
    mapping.inputs["Rotation"].default_value = np.radians(environment.rotation)
    texture.image = bpy.data.images.load(str(folder / environment.image), check_existing=True)
    background.inputs["Strength"].default_value = environment.strength
    links.new(coordinates.outputs["Generated"], mapping.inputs["Vector"])
    links.new(mapping.outputs[0], texture.inputs["Vector"])
    links.new(texture.outputs[0], background.inputs["Color"])
    return world


def add_cameras(scene: bpy.types.Scene, cameras: list[FrameCamera]) -> None:
    for camera in cameras:
        add_camera(scene, look_at(camera), camera.fov)
    bind_cameras(scene)


def bind_cameras(scene: bpy.types.Scene) -> None:
    """Give each of several cameras a frame of the animation."""
    cameras = [obj for obj in scene.collection.objects if obj.type == "CAMERA"]
    if len(cameras) > 1:
        for i, camera in enumerate(cameras):
            scene.timeline_markers.new(camera.name, frame=1 + i).camera = camera
        scene.frame_start, scene.frame_end, scene.frame_current = 1, len(cameras), 1


def add_camera(scene: bpy.types.Scene, camera_to_world: Matrix, degrees: float) -> None:
    data = bpy.data.cameras.new("Camera")
    data.angle, data.clip_start = math.radians(degrees), 1e-6
    camera = bpy.data.objects.new("Camera", data)
    camera.matrix_world = camera_to_world
    scene.collection.objects.link(camera)
    scene.camera = scene.camera or camera


def look_at(camera: FrameCamera) -> Matrix:
    """Camera to world. Raises SceneError for a camera that looks nowhere."""
    back = Vector(camera.position) - Vector(camera.look_at)
    right = Vector(camera.up).cross(back)
    if back.length < 1e-9 or right.length < 1e-9 * max(1.0, back.length):
        raise SceneError(f"the camera at {camera.position} looks nowhere: its look_at must be another point, and its "
                         "up must not point there")
    back.normalize()
    right.normalize()
    columns = [(*right, 0), (*back.cross(right), 0), (*back, 0), (*camera.position, 1)]
    return Matrix(columns).transposed()
