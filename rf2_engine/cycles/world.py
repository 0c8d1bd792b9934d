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
from .. import compat
from .. import passes as pass_table
from ..convert.camera.eyes import eyes
from ..convert.camera.lens import POSE
from ..convert.data.copied import Sun
from ..convert.lamps.placed_lamp import rotation
from ..convert.lamps.suns import split_suns
from ..convert.media.grids import shares
from ..convert.shading.input_nodes import LIT
from ..progress.status import Status
from ..registering import handlers
from . import background as background_cycles
from . import run as cycles_run
from . import session as cycles_session
from .fingerprint import of_tree, trees

_SETTINGS = {"cycles.pixel_filter_type": "BOX", "cycles.filter_width": 1.0, "cycles.use_denoising": False,
             "render.film_transparent": False}
RAYS = 1 << 19                # of a panorama
RAYS_OF_SUN = 1 << 17
MOST_SAMPLES = 256
AROUND = 2.0                  # radii of a sun: half of the window that is drawn of it
LEAST_WINDOW = math.radians(2)
SAME = math.cos(math.radians(3))  # of two suns
TO_X = np.array([(0.0, 0, -1), (-1, 0, 0), (0, 1, 0)])  # a camera that looks along +X, +Z up

_known: dict[str, tuple[np.ndarray, list[Sun]]] = {}  # by world and what it is made of, of one render job


@dataclass
class CyclesWorld:
    """What convert/world.py asks where it cannot evaluate a world as it is."""

    engine: bpy.types.RenderEngine
    depsgraph: bpy.types.Depsgraph
    status: Status

    def light(self, rough: list[Sun]) -> tuple[np.ndarray, list[Sun]] | None:
        """(256, 512, 3) f32 panorama without suns, and these; None where it cannot be drawn.

        rough: about where suns of Sky Textures are. Raises RenderCancelled after Esc.
        """
        world = compat.world(self.depsgraph)
        if not is_possible(self.depsgraph.scene_eval):
            return None
        if (key := of_tree(world)) in _known:
            return _known[key]
        try:
            drawn = self._light(rough)
        except (cycles_run.CyclesFailed, SceneError):
            return None
        finally:
            pass_table.write(self.engine, self.depsgraph.view_layer_eval.name, {})  # no panorama is left in the picture
            cycles_run.renew(self.engine, self.depsgraph)
        if drawn is not None:
            _known[key] = drawn
        return drawn

    def _light(self, rough: list[Sun]) -> tuple[np.ndarray, list[Sun]] | None:
        whole = self._drawn(np.eye(3), (math.pi, math.pi / 2), discs=False)
        if whole is None:
            return None
        environment, suns = split_suns(_resized(whole))
        for sun in rough:
            if all(sun.toward @ other.toward < SAME for other in suns):
                suns.append(self._measured(sun))
        return environment, [sun for sun in suns if sun.irradiance.any()]

    def _measured(self, sun: Sun) -> Sun:
        """The same with the light that there is more of than around it."""
        half = max(AROUND * sun.angle / 2, LEAST_WINDOW)
        pose = np.eye(3)
        pose[:, 2] = sun.toward
        window = self._drawn(np.roll(rotation(pose), 1, axis=1), (half, half), discs=True)
        height, width, _ = window.shape
        latitude, longitude = (half * (1 - 2 * (np.arange(n) + 0.5) / n) for n in (height, width))
        solid_angle = np.cos(latitude)[:, None] * (2 * half / height) * (2 * half / width)
        cosine = np.cos(latitude)[:, None] * np.cos(longitude)
        far = window[np.hypot(latitude[:, None], longitude) > 0.8 * half]
        around = np.median(far, axis=0) if len(far) else 0.0  # of a picture of a few pixels
        excess = np.maximum(window - around, 0)
        return Sun(sun.toward, np.einsum("ijc,ij->c", excess, solid_angle * cosine), sun.angle)

    def _drawn(self, frame: np.ndarray, half: tuple[float, float], discs: bool) -> np.ndarray | None:
        """(H, W, 3) of half so many radians of longitude and latitude; the columns of `frame` are the window's axes."""
        engine, depsgraph = self.engine, self.depsgraph
        wanted = [p for p in pass_table.of_session(depsgraph.view_layer_eval, ()) if p.key == "combined"]
        samples = (RAYS_OF_SUN if discs else RAYS) // max(engine.resolution_x * engine.resolution_y, 1)
        kept, engine.bl_use_gpu_context = engine.bl_use_gpu_context, True
        try:
            with cycles_run.overrides(engine, depsgraph) as override:
                override(depsgraph.scene_eval, cycles_session.ALWAYS | cycles_session.FIRST_HITS_ONLY | _SETTINGS
                         | {"cycles.samples": int(np.clip(samples, 1, MOST_SAMPLES))})
                if not _alone(compat.world(depsgraph), discs, override):
                    return None
                cycles_session.hide_all(depsgraph, override)
                _keep_still(depsgraph.scene_eval, override)
                for camera in {eye.camera for eye in eyes(engine, depsgraph)}:  # whose panoramas will be the same
                    _point(camera, frame, half, override)
                with self.status.during_cycles("World {}", share=0.1):
                    rendered = next(iter(self._run(wanted, override.changes).values()))
        finally:
            engine.bl_use_gpu_context = kept
        return rendered["combined"][..., :3].clip(0)

    def _run(self, wanted: list[pass_table.Pass], changes: list) -> dict[str, cycles_run.Passes]:
        """In a Blender in the background where there is a render border: a session draws no more than that."""
        scene, layer = self.depsgraph.scene_eval, self.depsgraph.view_layer_eval.name
        if not scene.render.use_border:
            return cycles_run.inside(self.engine, self.depsgraph, layer, wanted)
        whole = [*changes, background_cycles.changed(scene, "render.use_border", False)]
        job = background_cycles.Job.of(self.depsgraph, layer, wanted, whole)
        return {"": background_cycles.run(self.engine, job, wanted)}


@dataclass
class ExpectedWorld:
    """Instead of a CyclesWorld where nothing is rendered: only what will be reported is right."""

    def light(self, rough: list[Sun]) -> tuple[np.ndarray, list[Sun]]:
        return np.ones(ENVIRONMENT_SHAPE, np.float32), rough


def is_possible(scene: bpy.types.Scene) -> bool:
    """Whether panoramas can be drawn."""
    return scene.camera is not None and scene.camera.type == "CAMERA"


def _alone(world: bpy.types.World, discs: bool, override) -> bool:
    """Change the evaluated world into one that is seen as it lights; False where that cannot be done."""
    override(world, {"cycles_visibility.camera": True, "cycles.sampling_method": "NONE"})
    for owner, prefix, tree in trees(world):
        if not owner.is_evaluated:
            return False
        for i, link in enumerate(tree.links):
            kind, path = link.from_node.bl_idname, f"{prefix}links[{i}]"
            if link.to_node.type == "OUTPUT_WORLD" and link.to_socket.name == "Volume":
                override(owner, {f"{path}.is_muted": True})
            elif kind == "ShaderNodeLightPath":
                if not hasattr(link.to_socket, "default_value"):
                    return False
                answer, old = LIT.get(link.from_socket.name, 0.0), link.to_socket.default_value
                value = answer if isinstance(old, (int, float)) else [answer] * 3 + [1.0] * (len(old) - 3)
                override(owner, {f"{path}.to_socket.default_value": value, f"{path}.is_muted": True})
        for node in tree.nodes if not discs else ():
            if node.bl_idname == "ShaderNodeTexSky":
                override(owner, {f'{prefix}nodes["{bpy.utils.escape_identifier(node.name)}"].sun_disc': False})
    return True


def _keep_still(scene: bpy.types.Scene, override) -> None:
    for view_layer in scene.view_layers:
        name = bpy.utils.escape_identifier(view_layer.name)
        override(scene, {f'view_layers["{name}"].use_motion_blur': False})


def _point(camera: bpy.types.Object, frame: np.ndarray, half: tuple[float, float], override) -> None:
    longitude, latitude = half
    override(camera.data, {
        "dof.use_dof": False, "type": "PANO", "panorama_type": "EQUIRECTANGULAR", "latitude_min": -latitude,
        "latitude_max": latitude, "longitude_min": -longitude, "longitude_max": longitude, "shift_x": 0.0,
        "shift_y": 0.0, "stereo.convergence_mode": "PARALLEL", "stereo.use_spherical_stereo": False})
    pose = {name: getattr(camera, name) for name in POSE}
    override(camera, pose | {"matrix_world": Matrix((frame @ TO_X).tolist()).to_4x4()})


def _resized(panorama: np.ndarray) -> np.ndarray:
    """(256, 512, 3) f32: means of a fine one, a coarse one interpolated."""
    padded = np.pad(np.pad(panorama, ((1, 1), (0, 0), (0, 0)), "edge"), ((0, 0), (1, 1), (0, 0)), "wrap")
    for axis, count in enumerate(ENVIRONMENT_SHAPE[:2]):
        size = panorama.shape[axis]
        weights = shares(1.0, size / count, count, size + 2)
        padded = np.moveaxis(np.tensordot(weights, padded, (1, axis)), 0, axis)
    return padded.astype(np.float32)


@persistent
def _begin(*_):
    _known.clear()


register, _remove_handlers = handlers(("render_init", _begin))


def unregister() -> None:
    _known.clear()
    _remove_handlers()
