# SPDX-License-Identifier: GPL-3.0-or-later
"""Set the evaluated scene up for a session of Cycles."""
from __future__ import annotations

import math

import bpy

from .. import compat
from ..convert.copying.visibility import catching_hosts, shadow_catchers
from ..frame_settings import Light
from .overrides import Overrides
from .session_options import CameraModel, Catchers, SessionOptions

ALWAYS = {
    "cycles.film_exposure": 1.0,
    "cycles.use_adaptive_sampling": False,
    "cycles.use_sample_subset": False,
    "cycles.use_layer_samples": "IGNORE",
    "cycles.time_limit": 0.0,
    "cycles.use_auto_tile": True,
    "cycles.tile_size": 8192,  # Cycles' largest
}
PIXELS_PER_THREAD = 65536  # of a tile: a fraction of a second for each sample
FIRST_HITS_ONLY = {
    "cycles.device": "CPU",  # a few samples do not pay for loading GPU kernels
    "cycles.max_bounces": 0,
    "cycles.use_guiding": False,
    "cycles.use_fast_gi": False,
    "cycles.use_light_tree": False,  # a sixth of the time, for light that nobody looks at
}
# Light that is cheap and exact to trace: direct light with shadows, and what smooth mirrors and glass show. All that
# has bounced diffusely or in a volume is the network's work.
_TRACED = {
    "cycles.diffuse_bounces": 0,
    "cycles.volume_bounces": 0,
    "cycles.caustics_reflective": False,
    "cycles.caustics_refractive": False,
    "cycles.use_fast_gi": False,
    "cycles.use_guiding": False,
}
_DENOISED = {
    "cycles.use_denoising": True,
    "cycles.denoiser": "OPENIMAGEDENOISE",
    "cycles.denoising_input_passes": "RGB_ALBEDO_NORMAL",
    "cycles.denoising_prefilter": "FAST",  # glass and rough mirrors leave noise in the guiding passes
    "cycles.denoising_quality": "BALANCED",
}
# Only camera rays see anything: none is cast towards a light, and what costs a third of the time is left out.
_UNLIT = {f"visible_{ray}": False for ray in ("diffuse", "glossy", "transmission", "volume_scatter", "shadow")}
_WORLD_UNLIT = {f"cycles_visibility.{ray}": False for ray in ("diffuse", "glossy", "transmission", "scatter")}


def prepare_scene(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, options: SessionOptions,
                  override: Overrides) -> None:
    """Set the scene up for a session."""
    scene, camera = depsgraph.scene_eval, options.camera
    override(scene, ALWAYS | options.sampling.cycles_settings(scene.cycles.film_exposure) | {
        "cycles.tile_size": _tile_size(engine, depsgraph, options), "cycles.use_denoising": options.denoise,
        "render.film_transparent": not camera.opaque_film, "cycles.film_transparent_glass": camera.transparent_glass})
    if options.threads:
        override(scene, {"render.threads_mode": "FIXED", "render.threads": options.threads})
    if options.light is not Light.ALL:
        _set_camera(depsgraph, camera, override)
        _set_catchers(depsgraph, camera.catchers, override)
    if options.light is Light.NONE:
        _leave_out_light(depsgraph, override)
        if camera.is_blurred and compat.has_openimagedenoise():
            override(scene, _DENOISED)
    elif options.light is Light.TRACED:
        override(scene, _TRACED | (_DENOISED if options.is_denoised else {}))
        if options.has_volumes:
            override(scene, {"cycles.denoising_prefilter": "ACCURATE"})


def _tile_size(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, options: SessionOptions) -> int:
    """Pixels along the side of a tile; the whole picture is one where processors are quick enough for it.

    Cycles does not look at Esc before a tile has another sample. Several tiles take the detour over a file on disk, and
    are seen in the Image Editor only when all are there.
    """
    scene = depsgraph.scene_eval
    tile = PIXELS_PER_THREAD * (options.threads or scene.render.threads)
    is_quick = engine.resolution_x * engine.resolution_y < 8 * tile
    on_gpu = scene.cycles.device == "GPU" and options.light is not Light.NONE
    return ALWAYS["cycles.tile_size"] if is_quick or on_gpu else math.isqrt(tile)


def _set_camera(depsgraph: bpy.types.Depsgraph, camera: CameraModel, override: Overrides) -> None:
    scene, layer = depsgraph.scene_eval, bpy.utils.escape_identifier(depsgraph.view_layer_eval.name)
    override(scene, {"cycles.rolling_shutter_type": "NONE"})
    if not camera.motion_blur:
        override(scene, {f'view_layers["{layer}"].use_motion_blur': False})
    if not camera.depth_of_field:
        for data in {obj.data for obj in _objects(depsgraph) if obj.type == "CAMERA"}:  # each may be an eye
            override(data, {"dof.use_dof": False})
    if camera.move_cameras is not None:
        camera.move_cameras(override)


def _set_catchers(depsgraph: bpy.types.Depsgraph, catchers: Catchers, override: Overrides) -> None:
    if catchers is Catchers.CATCH:
        return
    if catchers is Catchers.CUT:
        for host in catching_hosts(depsgraph):
            override(host, {"is_holdout": True})
    for evaluated in shadow_catchers(depsgraph):
        override(evaluated, {"is_shadow_catcher": False})


def _leave_out_light(depsgraph: bpy.types.Depsgraph, override: Overrides) -> None:
    occluding = _knows_occlusion(depsgraph)
    override(depsgraph.scene_eval, FIRST_HITS_ONLY)
    if world := compat.world(depsgraph):
        override(world, _WORLD_UNLIT)
    for evaluated in _objects(depsgraph):
        override(evaluated, _UNLIT | ({"visible_shadow": evaluated.visible_shadow} if occluding else {}))


def _knows_occlusion(depsgraph: bpy.types.Depsgraph) -> bool:
    """Whether a pass or a shader asks for ambient occlusion, whose rays are shadow rays."""
    return depsgraph.view_layer_eval.use_pass_ambient_occlusion or any(
        node.bl_idname == "ShaderNodeAmbientOcclusion"
        for tree in depsgraph.ids if isinstance(tree, bpy.types.ShaderNodeTree) for node in tree.nodes)


def hide_all(depsgraph: bpy.types.Depsgraph, override: Overrides) -> None:
    """No ray meets any object, and Cycles does not even read them."""
    for evaluated in _objects(depsgraph):
        override(evaluated, _UNLIT | {"visible_camera": False})


def _objects(depsgraph: bpy.types.Depsgraph) -> list[bpy.types.Object]:
    """All evaluated ones, those too that show only as instances of others."""
    return [data for data in depsgraph.ids if isinstance(data, bpy.types.Object)]
