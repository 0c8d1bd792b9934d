# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw panoramas of worlds that only Cycles can evaluate, without any object, as they light the scene.

The pictures have the size of the render, because a session draws into the render's own result.
"""
from __future__ import annotations

import math
from dataclasses import dataclass

import bpy
import numpy as np
from bpy.app.handlers import persistent

from mathutils import Matrix

from ...model.errors import SceneError
from ...model.scene import ENVIRONMENT_SHAPE
from ...model.surface_kinds import Ray
from .. import compat
from .. import passes as pass_table
from ..convert.camera.eyes import eyes
from ..convert.camera.lens import POSE
from ..convert.data.copied import Sun
from ..convert.lamps.placed_lamp import rotation
from ..convert.lamps.suns import split_suns
from ..convert.media.grids import shares
from ..convert.shading.input_nodes import light_path_value
from ..progress.status import Status
from ..registering import handlers
from . import background as background_cycles
from . import run as cycles_run
from . import session_overrides
from .evaluated_scene import restore_objects
from .fingerprint import describe_world, node_trees
from .overrides import Overrides, overrides

_SETTINGS = {"cycles.pixel_filter_type": "BOX", "cycles.filter_width": 1.0, "cycles.use_denoising": False,
             "render.film_transparent": False}
RAYS = 1 << 19                # of a panorama
RAYS_OF_SUN = 1 << 17
MOST_SAMPLES = 256
WINDOW = 2.0                  # radii of a sun: half of the window that is drawn of it
LEAST_WINDOW = math.radians(2)
SAME_SUN = math.cos(math.radians(3))  # between the directions of two suns
TO_X = np.array([(0.0, 0, -1), (-1, 0, 0), (0, 1, 0)])  # a camera that looks along +X, +Z up

_panoramas: dict[tuple[str, Ray], tuple[np.ndarray, list[Sun]]] = {}  # of a render job, by what the world is made of


@dataclass
class CyclesWorld:
    """Draws the worlds that convert/lamps/world.py cannot evaluate."""

    engine: bpy.types.RenderEngine
    depsgraph: bpy.types.Depsgraph
    status: Status

    def light(self, rough_suns: list[Sun], ray: Ray) -> tuple[np.ndarray, list[Sun]] | None:
        """(256, 512, 3) f32 panorama without suns, as such rays see it, and the suns; None where it cannot be drawn.

        rough_suns: about where suns of Sky Textures are. Raises RenderCancelled after Esc.
        """
        world = compat.world(self.depsgraph)
        if not is_possible(self.depsgraph.scene_eval):
            return None
        if (key := (describe_world(world), ray)) in _panoramas:
            return _panoramas[key]
        try:
            drawn = self._draw_light(rough_suns, ray)
        except (cycles_run.CyclesFailed, SceneError):
            return None
        finally:
            pass_table.write(self.engine, self.depsgraph.view_layer_eval.name, {})  # no panorama is left in the picture
            restore_objects(self.engine, self.depsgraph)
        if drawn is not None:
            _panoramas[key] = drawn
        return drawn

    def _draw_light(self, rough_suns: list[Sun], ray: Ray) -> tuple[np.ndarray, list[Sun]] | None:
        panorama = self._draw(np.eye(3), (math.pi, math.pi / 2), ray, with_discs=False)
        if panorama is None:
            return None
        environment, suns = split_suns(_resize(panorama))
        for sun in rough_suns:
            if all(sun.toward @ other.toward < SAME_SUN for other in suns):
                suns.append(self._measure_sun(sun, ray))
        return environment, [sun for sun in suns if sun.irradiance.any()]

    def _measure_sun(self, sun: Sun, ray: Ray) -> Sun:
        """The sun with the irradiance that it adds to the sky around it."""
        half = max(WINDOW * sun.angle / 2, LEAST_WINDOW)
        pose = np.eye(3)
        pose[:, 2] = sun.toward
        window = self._draw(np.roll(rotation(pose), 1, axis=1), (half, half), ray, with_discs=True)
        height, width, _ = window.shape
        latitude, longitude = (half * (1 - 2 * (np.arange(n) + 0.5) / n) for n in (height, width))
        solid_angle = np.cos(latitude)[:, None] * (2 * half / height) * (2 * half / width)
        cosine = np.cos(latitude)[:, None] * np.cos(longitude)
        far = window[np.hypot(latitude[:, None], longitude) > 0.8 * half]
        sky = np.median(far, axis=0) if len(far) else 0.0  # of a picture of a few pixels
        excess = np.maximum(window - sky, 0)
        return Sun(sun.toward, np.einsum("ijc,ij->c", excess, solid_angle * cosine), sun.angle)

    def _draw(self, frame: np.ndarray, half: tuple[float, float], ray: Ray, with_discs: bool) -> np.ndarray | None:
        """(H, W, 3) radiance of a window of the world as such rays see it.

        frame: (3, 3), its axes as columns. half: of its longitude and latitude, radians. with_discs: Sky Textures show
        their suns.
        """
        engine, depsgraph = self.engine, self.depsgraph
        combined = [p for p in pass_table.session_passes(depsgraph.view_layer_eval, ()) if p.key == "combined"]
        samples = (RAYS_OF_SUN if with_discs else RAYS) // max(engine.resolution_x * engine.resolution_y, 1)
        had_context, engine.bl_use_gpu_context = engine.bl_use_gpu_context, True
        try:
            with overrides(engine, depsgraph) as override:
                override(depsgraph.scene_eval, session_overrides.ALWAYS | session_overrides.FIRST_HITS_ONLY | _SETTINGS
                         | {"cycles.samples": int(np.clip(samples, 1, MOST_SAMPLES))})
                if not _isolate(compat.world(depsgraph), ray, with_discs, override):
                    return None
                session_overrides.hide_all(depsgraph, override)
                _disable_motion_blur(depsgraph.scene_eval, override)
                for camera in {eye.camera for eye in eyes(engine, depsgraph)}:  # whose panoramas will be the same
                    _point_camera(camera, frame, half, override)
                with self.status.during_cycles("World {}", share=0.1):
                    rendered = next(iter(self._run(combined, override.changes).values()))
        finally:
            engine.bl_use_gpu_context = had_context
        return rendered["combined"][..., :3].clip(0)

    def _run(self, combined: list[pass_table.Pass], changes: list) -> dict[str, cycles_run.Passes]:
        """Render the world; with a render border in a background Blender, for a session draws no more than it."""
        scene, layer = self.depsgraph.scene_eval, self.depsgraph.view_layer_eval.name
        if not scene.render.use_border:
            return cycles_run.run_inside(self.engine, self.depsgraph, layer, combined)
        all_changes = [*changes, background_cycles.describe_change(scene, "render.use_border", False)]
        job = background_cycles.Job.create(self.depsgraph, layer, combined, all_changes)
        return {"": background_cycles.run(self.engine, job, combined)}


@dataclass
class PlaceholderWorld:
    """Takes the place of a CyclesWorld where nothing is rendered: only the report is right."""

    def light(self, rough_suns: list[Sun], ray: Ray) -> tuple[np.ndarray, list[Sun]]:
        return np.ones(ENVIRONMENT_SHAPE, np.float32), rough_suns


def is_possible(scene: bpy.types.Scene) -> bool:
    """Whether panoramas can be drawn."""
    return scene.camera is not None and scene.camera.type == "CAMERA"


def _isolate(world: bpy.types.World, ray: Ray, with_discs: bool, override: Overrides) -> bool:
    """Change the evaluated world into one that a camera sees as such rays do; False where that cannot be done."""
    override(world, {"cycles_visibility.camera": True, "cycles.sampling_method": "NONE"})
    for owner, prefix, tree in node_trees(world):
        if not owner.is_evaluated:
            return False
        for i, link in enumerate(tree.links):
            kind, path = link.from_node.bl_idname, f"{prefix}links[{i}]"
            if link.to_node.type == "OUTPUT_WORLD" and link.to_socket.name == "Volume":
                override(owner, {f"{path}.is_muted": True})
            elif kind == "ShaderNodeLightPath":
                if not hasattr(link.to_socket, "default_value"):
                    return False
                answer, old = light_path_value(link.from_socket.name, ray), link.to_socket.default_value
                value = answer if isinstance(old, (int, float)) else [answer] * 3 + [1.0] * (len(old) - 3)
                override(owner, {f"{path}.to_socket.default_value": value, f"{path}.is_muted": True})
        for node in tree.nodes if not with_discs else ():
            if node.bl_idname == "ShaderNodeTexSky":
                override(owner, {f'{prefix}nodes["{bpy.utils.escape_identifier(node.name)}"].sun_disc': False})
    return True


def _disable_motion_blur(scene: bpy.types.Scene, override: Overrides) -> None:
    for view_layer in scene.view_layers:
        name = bpy.utils.escape_identifier(view_layer.name)
        override(scene, {f'view_layers["{name}"].use_motion_blur': False})


def _point_camera(camera: bpy.types.Object, frame: np.ndarray, half: tuple[float, float], override: Overrides) -> None:
    longitude, latitude = half
    override(camera.data, {
        "dof.use_dof": False, "type": "PANO", "panorama_type": "EQUIRECTANGULAR", "latitude_min": -latitude,
        "latitude_max": latitude, "longitude_min": -longitude, "longitude_max": longitude, "shift_x": 0.0,
        "shift_y": 0.0, "stereo.convergence_mode": "PARALLEL", "stereo.use_spherical_stereo": False})
    pose = {name: getattr(camera, name) for name in POSE}
    override(camera, pose | {"matrix_world": Matrix((frame @ TO_X).tolist()).to_4x4()})


def _resize(panorama: np.ndarray) -> np.ndarray:
    """(256, 512, 3) f32: means of a fine one, a coarse one interpolated."""
    padded = np.pad(np.pad(panorama, ((1, 1), (0, 0), (0, 0)), "edge"), ((0, 0), (1, 1), (0, 0)), "wrap")
    for axis, count in enumerate(ENVIRONMENT_SHAPE[:2]):
        size = panorama.shape[axis]
        weights = shares(1.0, size / count, count, size + 2)
        padded = np.moveaxis(np.tensordot(weights, padded, (1, axis)), 0, axis)
    return padded.astype(np.float32)


@persistent
def _begin(*_):
    _panoramas.clear()


register, _remove_handlers = handlers(("render_init", _begin))


def unregister() -> None:
    _panoramas.clear()
    _remove_handlers()
