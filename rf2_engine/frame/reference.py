# SPDX-License-Identifier: GPL-3.0-or-later
"""Render Cycles' own picture beside ours: a second session of Cycles for the view layer, after our picture is on
screen.

Film, seed, bounces, device and all else are the scene's Cycles settings, so the result is what Cycles would render.
"""
from __future__ import annotations

import time
from functools import partial

import bpy
import numpy as np

from ...model import progress
from ...model.errors import RenderCancelled
from .. import compat
from .. import passes as pass_table
from ..convert.data.report import Report
from ..cycles import growing
from ..cycles import run as cycles_run
from ..cycles.overrides import overrides
from ..cycles.run import Passes
from ..progress.stages import REFERENCE
from ..reference_settings import FrameReference
from ..runtime import failure, model_cache, running
from . import output, reference_file
from .layer import Layer

NAME = REFERENCE.text  # of the pass, too
LOST = "a movie does not have it: choose an image format, or switch it off"


def is_requested(scene: bpy.types.Scene) -> bool:
    return scene.renderformer_v2.reference.use


def is_lost(scene: bpy.types.Scene) -> bool:
    """Whether no file of an animation will have the reference."""
    composed = scene.render.use_compositing and compat.compositor(scene)
    return is_requested(scene) and scene.render.is_movie_format and not composed


def register_passes(engine: bpy.types.RenderEngine, scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> None:
    """Announce the passes of the reference that `scene` asks for."""
    if is_requested(scene):
        light_passes = scene.renderformer_v2.reference.use_light_passes
        aovs = view_layer.aovs if scene.is_evaluated else ()  # cycles_run tells Cycles of the passes as AOVs
        for p in pass_table.REFERENCE if light_passes else pass_table.REFERENCE[:1]:
            if p.blender_name not in aovs:
                engine.register_pass(scene, view_layer, p.blender_name, len(p.channels), p.channels, p.kind)


def add(layer: Layer, pictures: dict[str, Passes], report: Report) -> int:
    """Render the reference and write it beside `pictures`, the passes of our views, which stay if Cycles is stopped.

    Must be called inside keep_scene (cycles/evaluated_scene.py), begun before the first run of this frame. Where Cycles
    renders on a GPU, the network leaves it. A reference that is stopped has the samples that it had by then. Returns
    its samples, 0 when there is none. Raises RenderCancelled when the add-on is being disabled; whatever else ends the
    reference is a line of `report`.
    """
    engine, chosen, rendered, begin = layer.engine, layer.settings.reference, {}, time.perf_counter()
    height, width, _ = next(iter(pictures.values()))["combined"].shape
    samples, seconds = chosen.samples, sum(layer.plan.seconds.values())
    if layer.depsgraph.scene_eval.cycles.device == "GPU":
        model_cache.leave_gpu()
    try:
        with layer.plan.enter(REFERENCE):
            progress.report(0.0, f"RenderFormer 100 %, {NAME}")
            with layer.status.during_cycles("RenderFormer 100 %, Cycles {}", time_limit=chosen.time_limit) as status, \
                    growing.announced(growing.CyclesPicture(
                        layer.name, width, height, seconds, partial(status.samples, samples), samples, begin,
                        *layer.corner, tuple(pictures))):
                rendered = _render(engine, layer.depsgraph, chosen, layer.settings.threads, report)
                if layer.status.esc_pressed():
                    samples = status.samples(chosen.samples)
                    raise RenderCancelled()
    except RenderCancelled as stop:  # it may have come after the last sample, too
        rendered = _stopped_reference(rendered, samples, pictures, chosen, report, why=str(stop))
        if running.is_stopping():
            raise
    except Exception as error:
        report.skipped(NAME, failure.message(error))
        engine.report({"WARNING"}, f"No {NAME}: {report.entries[-1][2]}")
    finally:  # Cycles shows its picture in Combined
        output.write_views(engine, layer.name, {view: passes | rendered.get(view, {})
                                                for view, passes in pictures.items()})
    if not rendered:
        return 0
    if 0 < chosen.time_limit < time.perf_counter() - begin:
        report.approximated(NAME, f"it may have fewer than {chosen.samples} samples because of its Time Limit")
    if engine.is_animation:
        for view, passes in rendered.items():
            _save(layer, view, passes["cycles_reference"], report)
    if chosen.denoise and not compat.has_openimagedenoise():
        report.approximated(NAME, "this Blender lacks OpenImageDenoise, so it is noisy: raise its samples")
    return samples


def _save(layer: Layer, view: str, pixels: np.ndarray, report: Report) -> None:
    """Save the reference to a file of its own, where the frames of the animation have one picture."""
    scene = layer.depsgraph.scene
    if is_lost(scene):
        report.approximated(NAME, LOST)
    elif reference_file.is_written(scene) and not layer.status.esc_pressed():  # then Blender writes no frame either
        try:
            reference_file.write(scene, layer.name, pixels, view)
        except RenderCancelled:
            if running.is_stopping():
                raise
        except (OSError, RuntimeError) as error:
            report.skipped(NAME, f"it cannot be saved beside the frame: {error}")


def _stopped_reference(rendered: dict[str, Passes], samples: int, pictures: dict[str, Passes],
                       chosen: FrameReference, report: Report, why: str = "") -> dict[str, Passes]:
    """What there is of a reference that was stopped: nothing before its first sample, as Combined was ours then.

    All its views, or none. why: there is nothing, if that is known better.
    """
    shown = [(passes.get("cycles_reference"), pictures[view]["combined"]) for view, passes in rendered.items()]
    if not samples or not shown or any(
            theirs is None or np.array_equal(theirs, ours, equal_nan=True) for theirs, ours in shown):
        report.skipped(NAME, why or "it was stopped before every pixel had a sample")
        return {}
    if samples < chosen.samples:
        report.approximated(NAME, f"it was stopped after {samples} of {chosen.samples} samples" +
                            (", and is not denoised" if chosen.denoise else ""))
    return rendered


def _render(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, chosen: FrameReference,
            threads: int, report: Report) -> dict[str, Passes]:
    """The passes of the reference by view: {key of passes.REFERENCE: (H, W, C) f32}, row 0 on top."""
    layer = depsgraph.view_layer_eval.name
    requested = [p for p in pass_table.PASSES if p.key == "combined" or chosen.light_passes and p.source == "lighting"]
    for p in requested:  # Cycles fills them under its own names
        engine.add_pass(p.blender_name, len(p.channels), p.channels, layer=layer)
    with overrides(engine, depsgraph) as override:
        override(depsgraph.scene_eval, {
            "cycles.samples": chosen.samples,
            "cycles.use_sample_subset": False,
            "cycles.use_layer_samples": "IGNORE",
            "cycles.time_limit": chosen.time_limit,
            "cycles.use_denoising": chosen.denoise,
        })
        override(depsgraph.scene_eval, dict(chosen.settings))
        if threads:
            override(depsgraph.scene_eval, {"render.threads_mode": "FIXED", "render.threads": threads})
        rendered = cycles_run.run(engine, depsgraph, layer, requested, override.changes, report, partial=True)
    return {view: {f"cycles_{'reference' if key == 'combined' else key}": pixels for key, pixels in passes.items()}
            for view, passes in rendered.items()}
