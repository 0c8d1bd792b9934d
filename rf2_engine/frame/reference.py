# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles' own picture beside ours: a second session of Cycles for the view layer, once our picture is on screen.

Film, seed, bounces, device and all else are the scene's Cycles settings, so that it is what Cycles would render.
"""
from __future__ import annotations

import time

import bpy
import numpy as np

from ...model import progress
from ...model.errors import RenderCancelled
from .. import compat
from .. import passes as pass_table
from ..convert.report import Report
from ..cycles import run as cycles_run
from ..progress.last_render import REFERENCE as NAME
from ..progress.status import Status
from ..reference_settings import FrameReference
from ..settings import FrameSettings
from . import failure, output, running


def is_wanted(scene: bpy.types.Scene) -> bool:
    return scene.renderformer_v2.reference.use


def register_passes(engine: bpy.types.RenderEngine, scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> None:
    """Announce the passes of the reference that `scene` asks for."""
    if is_wanted(scene):
        light_passes = scene.renderformer_v2.reference.use_light_passes
        aovs = view_layer.aovs if scene.is_evaluated else ()  # cycles_run tells Cycles of the passes as AOVs
        for p in pass_table.REFERENCE if light_passes else pass_table.REFERENCE[:1]:
            if p.blender_name not in aovs:
                engine.register_pass(scene, view_layer, p.blender_name, len(p.channels), p.channels, p.kind)


def add(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, picture: dict[str, np.ndarray],
        settings: FrameSettings, status: Status, report: Report) -> int:
    """Render the reference and write it beside `picture`, the passes of our frame, which stay if Cycles is stopped.

    Must be called inside cycles_run.scene_kept, begun before the first run of this frame. Returns the samples of the
    reference, 0 when there is none. Raises RenderCancelled when the add-on is being disabled; whatever else ends the
    reference is a line of `report`.
    """
    layer, chosen, found, begin = depsgraph.view_layer_eval.name, settings.reference, {}, time.perf_counter()
    try:
        with status.stage(NAME):
            progress.report(0.0, f"RenderFormer 100 %, {NAME}")
            with status.during_cycles("RenderFormer 100 %, Cycles {}", time_limit=chosen.time_limit):
                found = _render(engine, depsgraph, chosen, settings.threads, report)
    except RenderCancelled:
        found = {}  # it may have come after the last sample
        report.skipped(NAME, "it was stopped")
        if running.is_stopping():
            raise
    except Exception as error:
        report.skipped(NAME, failure.message(error))
        engine.report({"WARNING"}, f"no {NAME}: {report.entries[-1][2]}")
    finally:  # Cycles shows its picture in Combined
        output.write(engine, layer, picture | found)
    if found and 0 < chosen.time_limit < time.perf_counter() - begin:
        report.approximated(NAME, f"its Time Limit may have ended it before it had {chosen.samples} samples")
    if found and chosen.denoise and not compat.has_openimagedenoise():
        report.approximated(NAME, "this Blender lacks OpenImageDenoise, so it is noisy: raise its samples")
    return chosen.samples if found else 0


def _render(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, chosen: FrameReference,
            threads: int, report: Report) -> dict[str, np.ndarray]:
    """{key of passes.REFERENCE: (H, W, C) f32}, row 0 on top."""
    layer = depsgraph.view_layer_eval.name
    wanted = [p for p in pass_table.PASSES if p.key == "combined" or chosen.light_passes and p.source == "lighting"]
    for p in wanted:  # Cycles fills them under its own names
        engine.add_pass(p.blender_name, len(p.channels), p.channels, layer=layer)
    with cycles_run.overrides(engine, depsgraph) as override:
        override(depsgraph.scene_eval, {
            "cycles.samples": chosen.samples,
            "cycles.use_sample_subset": False,
            "cycles.use_layer_samples": "IGNORE",
            "cycles.time_limit": chosen.time_limit,
            "cycles.use_denoising": chosen.denoise,
        })
        if chosen.denoise and compat.has_openimagedenoise():
            override(depsgraph.scene_eval, {"cycles.denoiser": "OPENIMAGEDENOISE"})
        if threads:
            override(depsgraph.scene_eval, {"render.threads_mode": "FIXED", "render.threads": threads})
        found = cycles_run.run(engine, depsgraph, layer, wanted, override.changes, report)
    return {f"cycles_{'reference' if key == 'combined' else key}": pixels for key, pixels in found.items()}
