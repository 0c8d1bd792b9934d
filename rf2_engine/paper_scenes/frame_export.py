# SPDX-License-Identifier: GPL-3.0-or-later
"""A Blender scene as a prepared frame of the research code (docs/scene-input.md 8.4)."""
from __future__ import annotations

import os
import re
import shutil
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np

from ...model.errors import SceneError
from ...model.geometry import euler_angles
from ...model.published.obj_mesh import write_obj
from ...model.published.png_file import write_png
from ...model.published.prepared_frame import (
    MESHES,
    FrameCamera,
    FrameEnvironment,
    FrameMaterial,
    FrameObject,
    FrameVolume,
    PreparedFrame,
    write_frame,
)
from ...model.published.processed_scene import square_fov
from ...model.scene import RenderScene
from ..convert.camera.camera import convert_camera
from ..convert.collect import collect
from ..convert.copying.scene import copy
from ..convert.data import mesh as meshes
from ..convert.data.collected import CollectedScene, Part
from ..convert.data.copied import Instance
from ..convert.data.report import Report
from ..convert.lamps.lamps import convert_lamps
from ..convert.lamps.placed_lamp import BoundingSphere
from ..convert.lamps.world import convert_world_light
from ..convert.media.fog import add_fog
from ..cycles.world import CyclesWorld
from ..progress.status import Status
from ..render_size import frame_size
from .depsgraph import in_render
from .files import write_density, write_panorama
from .material_maps import LAMP, DescribedMaterial, describe

MOST_LAMP_TRIANGLES = 4096
ENVIRONMENT, EXTERNAL = "env_map.exr", "volumes"


def export_frame(scene: bpy.types.Scene, folder: Path, report: Report) -> PreparedFrame:
    """Write what F12 would show of the scene into a folder that is new or empty: all of it or nothing.

    The report names what the research code cannot show. Raises SceneError for a scene without surfaces, for a camera
    that it does not have, and for a folder that is not empty; OSError as the disk does.
    """
    folder = Path(folder)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise SceneError(f"{folder} is not empty: choose a new folder")
    partial = folder.with_name(f".{folder.name}.{os.getpid()}")
    try:
        frame = in_render(scene, lambda engine, depsgraph: _Export(partial, report, depsgraph).run(
            scene.name, CyclesWorld(engine, depsgraph, Status(engine))))
        if folder.exists():
            folder.rmdir()
        partial.rename(folder)
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return frame


class _Export:
    def __init__(self, folder: Path, report: Report, depsgraph):
        self.folder, self.report, self.depsgraph = folder, report, depsgraph
        self.frame = PreparedFrame("", {}, [])
        self._materials: dict[tuple, DescribedMaterial] = {}

    def run(self, name: str, cycles_world: CyclesWorld) -> PreparedFrame:
        self.frame.name, self.frame.cameras = name, self._cameras()
        copied = copy(self.depsgraph, self.report, cycles_world)
        sky = convert_world_light(copied.world, copied.world_panoramas, self.report, keep_suns=True)
        collected = collect(copied, self.report)
        if not collected.parts:
            raise SceneError(f'Scene "{name}" shows no surface: a frame needs at least one mesh')
        low, high = collected.bounds()
        clear = add_fog(collected, copied.world, np.float32([low, high]), None, None, self.report)
        lamps = convert_lamps(collected.lamps, sky.suns, MOST_LAMP_TRIANGLES, BoundingSphere.of_box(low, high), clear,
                              self.report)
        (self.folder / MESHES).mkdir(parents=True, exist_ok=True)
        for part in collected.parts:
            for instance in part.instances:
                self._add_part(part, instance)
        for lamp in lamps:
            self._add_lamp(lamp)
        self._add_media(collected)
        if sky.environment is not None:
            write_panorama(self.folder / ENVIRONMENT, sky.environment)
            self.frame.environment = FrameEnvironment(ENVIRONMENT)
        write_frame(self.frame, self.folder)
        return self.frame

    def _cameras(self) -> list[FrameCamera]:
        """The camera of the scene, then others that markers switch to."""
        scene = self.depsgraph.scene_eval
        width, height = frame_size(scene.render)
        view = convert_camera(self.depsgraph, width, height, None, self.report)
        if width != height:
            self.report.approximated("Camera", "the research code renders squares: the picture is extended to one")
        cameras = [_frame_camera(view.camera_to_world, square_fov(view))]
        markers = sorted(scene.timeline_markers, key=lambda marker: marker.frame)
        bound = dict.fromkeys(marker.camera for marker in markers if marker.camera and marker.camera.type == "CAMERA")
        active = scene.camera.original
        for camera in bound:
            if camera.original != active and camera.data.type == "PERSP":
                evaluated = camera.evaluated_get(self.depsgraph)
                matrix = np.array(evaluated.matrix_world.normalized(), np.float64)
                cameras.append(_frame_camera(matrix, float(np.degrees(evaluated.data.angle))))
        return cameras

    def _add_part(self, part: Part, instance: Instance) -> None:
        for slot in np.unique(part.mesh.slot):
            mesh = part.mesh.take(part.mesh.slot == slot)
            described = self._describe_material(part.materials[slot], mesh, instance)
            corners, normals = meshes.transform(mesh, instance.matrix)
            usable = meshes.within_reach(corners) & meshes.has_area(corners)
            if usable.any():
                uv = mesh.uv.get(mesh.active_uv)
                self._add(instance.name or part.name, corners[usable], normals[usable],
                          None if uv is None else uv[usable], described)

    def _describe_material(self, material, mesh, instance: Instance) -> DescribedMaterial:
        """The description of a material; computed once if nothing in it depends on the mesh or the instance."""
        key = material, mesh.active_uv
        if key not in self._materials:
            before = len(self.report.entries)
            described = describe(material, mesh, instance, self.report)
            if len(self.report.entries) > before:  # it may be another one elsewhere
                return described
            self._materials[key] = described
        return self._materials[key]

    def _add(self, name: str, corners, normals, uv, described: DescribedMaterial) -> None:
        key = self._new_key(name)
        write_obj(self.folder / MESHES / f"{key}.obj", corners, normals, uv)
        material, files = described.material, f"{MESHES}/{key}"
        if described.maps or described.latent is not None:
            (self.folder / files).mkdir()
        for map_name, pixels in described.maps.items():
            write_png(self.folder / files / f"{map_name}.png", pixels)
        if described.latent is not None:
            np.save(self.folder / files / "latent.npy", described.latent)
            material = replace(material, latent=f"{files}/latent.npy")
        flat = (np.ptp(normals, axis=1) < 1e-4).all(axis=1)
        material = replace(material, folder=files if described.maps else None, is_smooth=bool(flat.mean() < 0.5))
        self.frame.objects[key] = FrameObject(f"{MESHES}/{key}.obj", material, is_light=any(material.emission))

    def _add_lamp(self, lamp: RenderScene) -> None:
        emits = lamp.is_light
        if lamp.beam_axis[emits].any():
            self.report.approximated("Lamps", "lamps that shine to one side alone shine to all sides")
        for radiance in np.unique(lamp.emission[emits], axis=0):
            rows = (lamp.emission == radiance).all(axis=1)
            material = FrameMaterial("homo_diffuse_specular", LAMP, emission=tuple(radiance.tolist()))
            self._add("Lamp", lamp.triangles[rows], lamp.normals[rows], None, DescribedMaterial(material))

    def _add_media(self, collected: CollectedScene) -> None:
        for i, medium in enumerate(collected.media):
            file = f"{EXTERNAL}/volume_{i}.vdb"
            (self.folder / EXTERNAL).mkdir(exist_ok=True)
            peak = write_density(self.folder / file, medium)
            if peak is None:
                self.report.skipped(medium.name, "its volume cannot be written without the Python module openvdb")
            elif peak:
                size = medium.box.size
                unit = peak * np.sqrt(np.mean(np.square(size)))
                # The research code puts voxels half a voxel too high, which it expects of the file (5.3).
                center = medium.box.center - medium.box.rotation @ (size / 64)
                self.frame.volumes.append(FrameVolume(
                    file, tuple(center.tolist()), tuple(np.degrees(euler_angles(medium.box.rotation)).tolist()),
                    tuple(size.tolist()), tuple((medium.scattering * unit).tolist()),
                    tuple((medium.absorption * unit).tolist())))

    def _new_key(self, name: str) -> str:
        """A new name for files and for Blender's objects, by which the research code finds them."""
        stem = re.sub(r"[^A-Za-z0-9_-]", "_", name)[:50] or "Object"
        key, count = stem, 0
        while key.lower() in (other.lower() for other in self.frame.objects):  # names on Windows have no case
            key, count = f"{stem}_{count + 1:03d}", count + 1
        return key


def _frame_camera(camera_to_world: np.ndarray, degrees: float) -> FrameCamera:
    right, up, back, position = camera_to_world[:3].astype(np.float64).T
    return FrameCamera(tuple(position.tolist()), tuple((position - back).tolist()), tuple(up.tolist()), degrees)
