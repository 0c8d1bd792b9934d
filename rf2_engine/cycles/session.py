# SPDX-License-Identifier: GPL-3.0-or-later
"""Render passes with Cycles inside our own engine, with exact first hits for any material.

Cycles computes the passes that our render result has and obeys render border, resolution percentage, view layer,
overrides and Esc by itself. It frees the evaluated scene when it ends (unless Persistent Data is on, or inside
`run.keep_scene`), so everything else must be read from the depsgraph before `render_passes`.
"""
from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from enum import Enum, auto
from typing import NamedTuple

import bpy
import numpy as np

from ...model.light_passes import LOBES
from ...model.pictures import HALF_MAX, box_sums
from .. import compat
from .. import passes as pass_table
from ..convert.copying.visibility import catching_hosts, shadow_catchers
from ..convert.data.report import Report
from ..convert.shading.closure import BRIGHTEST
from ..sampling import Sampling
from ..settings import Light
from ..setup import packages
from .run import Passes, overrides, run

ALWAYS = {
    "cycles.film_exposure": 1.0,
    "cycles.use_adaptive_sampling": False,
    "cycles.use_sample_subset": False,
    "cycles.use_layer_samples": "IGNORE",
    "cycles.time_limit": 0.0,
    "cycles.use_auto_tile": True,
    "cycles.tile_size": 8192,  # Cycles' largest
}
BESIDE = 2           # pixels from an emitter, as far as the denoiser smooths its edge
MEDIA_ALBEDO = 0.01  # what media, which no colour pass shows, count as beside surfaces
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


class Catchers(Enum):
    """What shadow catchers are in a session."""

    SHOWN = auto()  # objects like any other
    CUT = auto()    # holes in the film
    CATCH = auto()  # what they are for


class CameraModel(NamedTuple):
    """The camera of a session: by default a pinhole where the scene has its camera, one moment, a transparent film.

    Cycles then gives coverage as alpha, while the Environment pass still holds the world seen directly (measured: Env =
    world * (1 - alpha) in both film modes), so an opaque film is combined + environment.
    """

    depth_of_field: bool = False     # as the scene has it
    motion_blur: bool = False        # as the scene has it
    transparent_glass: bool = False  # the film is transparent behind glass too
    opaque_film: bool = False        # alpha is 1, but for holdouts
    catchers: Catchers = Catchers.SHOWN
    move_cameras: Callable[[Callable], None] | None = None  # called with the function of run.overrides

    @property
    def is_blurred(self) -> bool:
        return self.depth_of_field or self.motion_blur


PINHOLE = CameraModel()


def render_passes(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, **options) -> Passes:
    """As `render_views`, for a render without stereoscopy."""
    passes, = render_views(engine, depsgraph, **options).values()
    return passes


def render_views(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, *, sampling: Sampling, light: Light,
                 model: CameraModel = PINHOLE, denoise: bool = False, hazy: bool = False,
                 threads: int = 0, report: Report | None = None,
                 groups: Sequence[pass_table.Pass] = ()) -> dict[str, Passes]:
    """Run one Cycles session for the view layer of `depsgraph` and return the passes of a final render, by view.

    `engine` is the RenderEngine inside whose `render` this is called; the camera of Light.ALL is the scene's, whatever
    `model` says; `threads` 0 leaves them to Blender's setting;
    `hazy` says that smoke or fog leaves noise in the first hits, which the denoiser then must not take for texture.
    With Light.NONE no ray is cast towards a light and the result holds first-hit data only. With Light.TRACED it also
    holds "traced" (H, W, 3), the radiance of direct light and of what smooth mirrors and glass show, without emitters
    seen directly, denoised where Blender can, then also "noise" (H, W, 3), what the denoiser took away, and the light
    passes (never denoised) of passes.needed_light; where shadow catchers catch also "combined" as with Light.ALL.
    `groups`: passes of light groups that the result shall hold too: all light of the session, noisy, with emitters and
    world seen directly, in a transparent film as well.
    With Light.ALL the scene's own bounces are used and the result also holds "combined" (denoised by OpenImageDenoise
    if `denoise`) and all light passes.

    Returns {view: {key of passes.PASSES: (H, W, C) f32}}, row 0 on top, for the render border only; plus "alpha"
    (H, W, 1), coverage, and "samples" (H, W, 1), how many a pixel has. The view is "" without
    stereoscopy. Colours are scene-linear and premultiplied by coverage. "combined" has no directly seen world: add
    "environment" for an opaque film. "depth" and "position" belong to the pixel centre (Cycles writes them for its
    first sample alone, which it puts there): 1e10 and 0 where that ray hits nothing. "normal" and the colours are sums
    over the samples that hit something, divided by all samples.

    Raises RenderCancelled after Esc, SceneError when Cycles is switched off or stops with an error.
    """
    packages.require_cycles()
    view_layer = depsgraph.view_layer_eval
    clean = light is Light.TRACED and compat.has_openimagedenoise()
    lobes = {Light.ALL: pass_table.LIGHTING, Light.NONE: (),
             Light.TRACED: pass_table.needed_light(view_layer, pass_table.LIGHTING)}[light]
    layer_name, noisy = view_layer.name, pass_table.NOISY
    requested = [p for p in pass_table.session_passes(view_layer, lobes) if p != noisy] + [noisy] * clean + [*groups]
    if model.catchers is Catchers.CATCH and pass_table.SHADOW_CATCHER.is_ticked(view_layer):
        requested.append(pass_table.SHADOW_CATCHER)
    if light is Light.NONE:
        sampling = sampling.fixed  # Cycles takes unlit surfaces for clean, whatever their edges are
    if sampling.is_adaptive and pass_table.SAMPLE_COUNT not in requested:
        requested.append(pass_table.SAMPLE_COUNT)
    for p in requested:  # those that were registered are there already, and stay as they are
        engine.add_pass(p.blender_name, len(p.channels), p.channels, layer=layer_name)

    settings = ALWAYS | sampling.cycles_settings(depsgraph.scene_eval.cycles.film_exposure) | {
        "cycles.tile_size": _tile_size(engine, depsgraph, light, threads),
        "cycles.use_denoising": denoise, "render.film_transparent": not model.opaque_film,
        "cycles.film_transparent_glass": model.transparent_glass}
    if threads:
        settings |= {"render.threads_mode": "FIXED", "render.threads": threads}
    with overrides(engine, depsgraph) as override:
        override(depsgraph.scene_eval, settings)
        if light is not Light.ALL:
            _set_camera(depsgraph, model, override)
            _set_catchers(depsgraph, model.catchers, override)
        if light is Light.NONE:
            _leave_out_light(depsgraph, override, occluding=view_layer.use_pass_ambient_occlusion)
            if model.is_blurred and compat.has_openimagedenoise():
                override(depsgraph.scene_eval, _DENOISED)
        elif light is Light.TRACED:
            override(depsgraph.scene_eval, _TRACED | (_DENOISED if clean else {}))
            if hazy:
                override(depsgraph.scene_eval, {"cycles.denoising_prefilter": "ACCURATE"})
        views = run(engine, depsgraph, layer_name, requested, override.changes, report or Report())

    for rendered in views.values():
        _make_finite(rendered, report or Report())
        combined = rendered["combined"]
        rendered["alpha"] = combined[..., 3:].copy()
        share = rendered.get(pass_table.SAMPLE_COUNT.key)
        rendered["samples"] = np.zeros_like(rendered["alpha"]) + sampling.counts(share)
        seen = ["emission", "environment"] if model.opaque_film else ["emission"]
        if clean:
            noisy_light = _not_seen(rendered, seen, noisy.key)
            rendered["noise"] = rendered.pop(noisy.key)[..., :3] - combined[..., :3]
        if light is not Light.ALL and model.is_blurred and model.catchers is not Catchers.CATCH:
            _denoise_seen(rendered, seen)
        if light is Light.TRACED:
            rendered["traced"] = _not_seen(rendered, seen)
            if clean:
                rendered["traced"] = _beside_emitters(rendered["traced"], noisy_light, rendered)
        elif light is Light.NONE and model.is_blurred:  # there is no light, so it is what noise has left out
            rendered["emission"] = rendered["emission"] + _not_seen(rendered, seen)
        if light is not Light.ALL and model.catchers is not Catchers.CATCH:
            del rendered["combined"]
    return views


def _denoise_seen(rendered: Passes, seen: list[str]) -> None:
    """Dim what is seen directly, which has the noise of a blur, to what the denoised picture leaves for it."""
    total = sum(rendered[name] for name in seen)
    share = np.where(total > 0, rendered["combined"][..., :3].clip(0) / np.where(total > 0, total, 1), 1).clip(max=1)
    for name in seen:
        rendered[name] = rendered[name] * share


def _not_seen(rendered: Passes, seen: list[str], picture: str = "combined") -> np.ndarray:
    """(H, W, 3) of the picture, without what is seen directly."""
    return (rendered[picture][..., :3] - sum(rendered[name] for name in seen)).clip(0)


def _beside_emitters(light: np.ndarray, noisy: np.ndarray, rendered: Passes) -> np.ndarray:
    """Denoised `light` (H, W, 3) of surfaces, beside emitters its median with `noisy` light and with that around.

    The denoiser smooths the edges of emitters, which their pass does not have: small ones would shine twice. The light
    beside them may be far above what is around it all the same, as in metal that they lie on.
    """
    beside = box_sums(rendered["emission"].max(axis=-1, keepdims=True), BESIDE) > 0
    if not beside.any():
        return light
    albedo = MEDIA_ALBEDO + sum(rendered[f"{lobe}_color"] for lobe in LOBES)
    around = albedo * box_sums(noisy, 1) / box_sums(albedo, 1)
    low, high = np.minimum(light, noisy), np.maximum(light, noisy)
    return np.where(beside, around.clip(low, high), light)


def _tile_size(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, light: Light, threads: int) -> int:
    """Pixels along the side of a tile; the whole picture is one where processors are quick enough for it.

    Cycles does not look at Esc before a tile has another sample. Several tiles take the detour over a file on disk, and
    are seen in the Image Editor only when all are there.
    """
    scene = depsgraph.scene_eval
    tile = PIXELS_PER_THREAD * (threads or scene.render.threads)
    is_quick = engine.resolution_x * engine.resolution_y < 8 * tile
    on_gpu = scene.cycles.device == "GPU" and light is not Light.NONE
    return ALWAYS["cycles.tile_size"] if is_quick or on_gpu else math.isqrt(tile)


def _make_finite(rendered: Passes, report: Report) -> None:
    """Normalised vectors of no length are NaN in Cycles: it lets a pixel be black then, but not its passes.

    So surfaces with such a normal have no colour. Colours of surfaces end where the scene's do: beyond, light times
    them is no number.
    """
    is_black = ~np.isfinite(rendered["normal"]).all(axis=-1)
    for key, values in rendered.items():
        if not np.isfinite(values).all():
            report.approximated(key.replace("_", " ").title(),
                                "where Cycles' pass holds no number, 0 is taken: look for a Normal or Tangent of 0 in "
                                "materials")
            values = np.nan_to_num(values, posinf=HALF_MAX, neginf=-HALF_MAX)
        if key.endswith("_color") and (is_black.any() or values.max(initial=0) > BRIGHTEST):
            values = np.where(is_black[..., None], 0, values.clip(max=BRIGHTEST))
        rendered[key] = values


def _set_camera(depsgraph: bpy.types.Depsgraph, model: CameraModel, override) -> None:
    scene, layer = depsgraph.scene_eval, bpy.utils.escape_identifier(depsgraph.view_layer_eval.name)
    override(scene, {"cycles.rolling_shutter_type": "NONE"})
    if not model.motion_blur:
        override(scene, {f'view_layers["{layer}"].use_motion_blur': False})
    if not model.depth_of_field:
        for data in {obj.data for obj in _objects(depsgraph) if obj.type == "CAMERA"}:  # each may be an eye
            override(data, {"dof.use_dof": False})
    if model.move_cameras is not None:
        model.move_cameras(override)


def _set_catchers(depsgraph: bpy.types.Depsgraph, catchers: Catchers, override) -> None:
    if catchers is Catchers.CATCH:
        return
    if catchers is Catchers.CUT:
        for host in catching_hosts(depsgraph):
            override(host, {"is_holdout": True})
    for evaluated in shadow_catchers(depsgraph):
        override(evaluated, {"is_shadow_catcher": False})


def _leave_out_light(depsgraph: bpy.types.Depsgraph, override, occluding: bool) -> None:
    """`occluding`: ambient occlusion is requested, whose rays are shadow rays."""
    override(depsgraph.scene_eval, FIRST_HITS_ONLY)
    if world := compat.world(depsgraph):
        override(world, _WORLD_UNLIT)
    for evaluated in _objects(depsgraph):
        override(evaluated, _UNLIT | ({"visible_shadow": evaluated.visible_shadow} if occluding else {}))


def hide_all(depsgraph: bpy.types.Depsgraph, override) -> None:
    """No ray meets any object, and Cycles does not even read them."""
    for evaluated in _objects(depsgraph):
        override(evaluated, _UNLIT | {"visible_camera": False})


def _objects(depsgraph: bpy.types.Depsgraph) -> list[bpy.types.Object]:
    """All evaluated ones, those too that show only as instances of others."""
    return [data for data in depsgraph.ids if isinstance(data, bpy.types.Object)]
