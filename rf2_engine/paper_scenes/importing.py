# SPDX-License-Identifier: GPL-3.0-or-later
"""A prepared frame of the research code as a Blender scene (docs/scene-input.md 8.4, 10)."""
from __future__ import annotations

import math
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
    missing,
    pointers,
    read_frame,
)
from ...model.weights.files import lfs_remedy
from ..engine import RenderFormerEngine
from . import material_nodes

SMOOTH = math.radians(30)  # between faces, where the file has no normals
RESOLUTION = 512


def import_frame(folder: Path, report, resolution: int = RESOLUTION) -> bpy.types.Scene:
    """A new scene beside those of the open file, whose F12 shows the frame: square, `resolution` pixels on each side.

    What is missing or cannot be used is in the report (convert/report.py), and left out.
    Raises SceneError for a folder that is no frame, and for one that shows nothing.
    """
    folder = Path(folder).resolve()
    frame = read_frame(folder)
    for name in missing(frame, folder):
        report.skipped(frame.name, f"{name} is not in {folder}: put it there and import again")
    for name in pointers(frame, folder):
        report.skipped(frame.name, f"{name} {lfs_remedy(folder)}, and import again")
    meshes = {key: _read(folder / it.mesh, report) for key, it in frame.objects.items()}
    if not frame.cameras:
        raise SceneError(f"{folder} has no camera: add one to its scene_config.json")
    scene = bpy.data.scenes.new(frame.name)
    try:
        for key, it in frame.objects.items():
            if meshes[key] is not None:
                _add_object(scene, key, it, meshes[key], folder, report)
        for i, volume in enumerate(frame.volumes):
            _add_volume(scene, f"Volume {i + 1}", volume, folder)
        scene.world = world(frame.name, folder, frame.environment)
        add_cameras(scene, frame.cameras)
        settle(scene, resolution, sum(int((it.sizes - 2).sum()) for it in meshes.values() if it))
    except BaseException:
        bpy.data.scenes.remove(scene)
        raise
    return scene


def settle(scene: bpy.types.Scene, resolution: int, triangles: int) -> None:
    """Square pictures without background, by our engine; all triangles as they are, and light and scale too."""
    scene.render.engine = RenderFormerEngine.bl_idname
    scene.render.resolution_x = scene.render.resolution_y = resolution
    scene.render.resolution_percentage = 100
    scene.render.film_transparent = True
    scene.view_settings.view_transform = "Standard"
    ours = scene.renderformer_v2
    ours.as_is, ours.max_edge, ours.token_budget = True, 1, max(triangles, 256)


def _read(file: Path, report) -> ObjMesh | None:
    if not file.is_file():
        return None  # it is reported already
    try:
        found = read_obj(file)
    except SceneError as error:
        report.refused(file.name, str(error))
        return None
    if not len(found.sizes):
        report.skipped(file.name, f"{file} has no face that has an area")
    return found


def _add_object(scene, key: str, it: FrameObject, mesh: ObjMesh, folder: Path, report) -> None:
    made = mesh_of(key, mesh, it.material)
    made.materials.append(material_nodes.build(key, it.material, folder, report))
    added = bpy.data.objects.new(key, made)
    added.visible_camera = not any(it.material.emission)  # no picture of the training shows a lamp
    scene.collection.objects.link(added)


def mesh_of(name: str, obj: ObjMesh, material: FrameMaterial) -> bpy.types.Mesh:
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


def _add_volume(scene, name: str, it: FrameVolume, folder: Path) -> None:
    if not (folder / it.grid).is_file():
        return
    volume = bpy.data.volumes.new(name)
    volume.filepath = str(folder / it.grid)
    volume.materials.append(material_nodes.medium(name, it.scattering, it.absorption))
    added = bpy.data.objects.new(name, volume)
    added.location, added.scale = it.translation, it.scale
    added.rotation_euler = np.radians(it.rotation)
    scene.collection.objects.link(added)


def world(name: str, folder: Path, environment: FrameEnvironment | None) -> bpy.types.World:
    """Black where there is no panorama."""
    made = bpy.data.worlds.new(name)
    made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    nodes.clear()
    output, background = nodes.new("ShaderNodeOutputWorld"), nodes.new("ShaderNodeBackground")
    links.new(background.outputs[0], output.inputs["Surface"])
    background.inputs["Color"].default_value = (0, 0, 0, 1)
    if environment is None or not (folder / environment.image).is_file():
        background.inputs["Strength"].default_value = 0
        return made
    place, turn, image = map(nodes.new, ("ShaderNodeTexCoord", "ShaderNodeMapping", "ShaderNodeTexEnvironment"))
    turn.inputs["Rotation"].default_value = np.radians(environment.rotation)
    image.image = bpy.data.images.load(str(folder / environment.image), check_existing=True)
    background.inputs["Strength"].default_value = environment.strength
    links.new(place.outputs["Generated"], turn.inputs["Vector"])
    links.new(turn.outputs[0], image.inputs["Vector"])
    links.new(image.outputs[0], background.inputs["Color"])
    return made


def add_cameras(scene: bpy.types.Scene, cameras: list[FrameCamera]) -> None:
    for it in cameras:
        add_camera(scene, look_at(it), it.fov)
    bind_cameras(scene)


def bind_cameras(scene: bpy.types.Scene) -> None:
    """The first is active; of several each has a frame of the animation."""
    several = [obj for obj in scene.collection.objects if obj.type == "CAMERA"]
    if len(several) > 1:
        for i, camera in enumerate(several):
            scene.timeline_markers.new(camera.name, frame=1 + i).camera = camera
        scene.frame_start, scene.frame_end, scene.frame_current = 1, len(several), 1


def add_camera(scene: bpy.types.Scene, camera_to_world: Matrix, degrees: float) -> None:
    data = bpy.data.cameras.new("Camera")
    data.angle, data.clip_start = math.radians(degrees), 1e-6
    camera = bpy.data.objects.new("Camera", data)
    camera.matrix_world = camera_to_world
    scene.collection.objects.link(camera)
    scene.camera = scene.camera or camera


def look_at(it: FrameCamera) -> Matrix:
    """Raises SceneError for a camera that looks nowhere."""
    back = Vector(it.position) - Vector(it.look_at)
    right = Vector(it.up).cross(back)
    if back.length < 1e-9 or right.length < 1e-9 * max(1.0, back.length):
        raise SceneError(f"the camera at {it.position} looks nowhere: its look_at must be another point, and its up "
                         "must not point there")
    back.normalize()
    right.normalize()
    columns = [(*right, 0), (*back.cross(right), 0), (*back, 0), (*it.position, 1)]
    return Matrix(columns).transposed()
