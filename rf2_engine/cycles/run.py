# SPDX-License-Identifier: GPL-3.0-or-later
"""Run Cycles once inside our own engine: the session, its settings, and the passes that it wrote."""
from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np

from ...model.errors import RenderCancelled, SceneError
from .. import passes as pass_table
from ..convert.camera.eyes import view_names
from ..convert.data.report import Report
from ..runtime import failure
from . import background as background_cycles
from . import growing
from .evaluated_scene import loses_modifiers, survives

Passes = dict[str, np.ndarray]  # of one view: {key: (H, W, C) f32}, row 0 on top


class CyclesFailed(Exception):
    """Cycles' own functions are not there, have other parameters or fail; the cause is what Python raised."""


@contextmanager
def _cycles_errors():
    """Errors of Cycles' own functions become CyclesFailed; around nothing else, for the same from ours are faults."""
    try:
        yield
    except (ImportError, AttributeError, TypeError, RuntimeError, SystemError) as error:
        raise CyclesFailed(str(error)) from error


def run(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, layer: str,
        requested: list[pass_table.Pass], changes: list, report: Report, partial: bool = False) -> dict[str, Passes]:
    """Render the view layer of `depsgraph`, called `layer`, with its settings as they are.

    Returns the `requested` passes by view, which is "" without stereoscopy; the result of `engine` must have them.
    Where Cycles cannot be run inside Blender, a Blender in the background renders, with the `changes` of the
    settings (overrides.py), and the report says so.
    After Esc it raises RenderCancelled; if `partial`, it returns what was rendered so far instead.
    Raises SceneError when Cycles stops with an error.
    """
    job = background_cycles.Job.create(depsgraph, layer, requested, changes)
    try:
        rendered = run_inside(engine, depsgraph, layer, requested, partial)
    except CyclesFailed as error:
        if failure.is_out_of_memory(error.__cause__):
            raise error.__cause__ from None
        rendered = _run_outside(engine, job, requested, error.__cause__, report, partial)
    if engine.test_break():
        if partial:
            return rendered
        raise RenderCancelled()
    missing = [p.blender_name for p in requested if any(p.key not in passes for passes in rendered.values())]
    if missing:
        raise SceneError(f"Cycles stopped without the passes {', '.join(missing)}: see its message in the console")
    return rendered


def run_inside(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, layer: str,
           requested: list[pass_table.Pass], partial: bool = False) -> dict[str, Passes]:
    """As `run`, but raises CyclesFailed where Cycles fails, and passes may be missing."""
    has_lost_modifiers = loses_modifiers(engine, depsgraph)
    denoised = pass_table.is_denoised(depsgraph.view_layer_eval, depsgraph.scene_eval)
    with _with_our_passes(engine, depsgraph, layer), _session(engine) as cycles_engine:
        with _cycles_errors():
            cycles_engine.reset(engine, bpy.data, depsgraph)
            with growing.drawable(engine):
                cycles_engine.render(engine, depsgraph)
            if engine.test_break() and not partial:
                _forget_tiles()
                raise RenderCancelled()
            cycles_engine.render_frame_finish(engine)  # tiled pictures reach the render result only here
        rendered = _read(engine.get_result(), layer, requested, denoised)
    engine.has_lost_modifiers = has_lost_modifiers
    return rendered


def _forget_tiles() -> None:
    """Cycles removes its file of tiles when it has read it, which takes as long as the picture is large."""
    for file in Path(bpy.app.tempdir).glob("cycles-tile-buffer-*"):
        file.unlink(missing_ok=True)


def _run_outside(engine, job, requested, why: Exception, report: Report, partial: bool) -> dict[str, Passes]:
    reason = str(why).splitlines()[0] if str(why) else type(why).__name__
    if view_names(engine) != [""]:
        raise SceneError(f"Cycles cannot be run inside this Blender ({reason}), which stereoscopy needs: switch it off "
                         "in Output Properties > Stereoscopy") from why
    try:
        rendered = background_cycles.run(engine, job, requested, partial)
    except SceneError as error:
        raise SceneError(f"Cycles cannot be run inside this Blender ({reason}), and {error}") from why
    report.approximated("Cycles", f"it cannot be run inside this Blender ({reason}), so a Blender in the background "
                                  "rendered a copy of the scene: this takes a few seconds longer, and simulations "
                                  "that are not baked are missing")
    return {"": rendered}


@contextmanager
def _with_our_passes(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, layer: str):
    """Make those of our own passes that Cycles does not know AOVs of the evaluated view layer inside.

    No shader writes to them. Without them Cycles prints an error for each, once per run.
    """
    is_kept, aovs = survives(engine, depsgraph), depsgraph.view_layer_eval.aovs
    names = dict.fromkeys(p.name for p in engine.get_result().layers[layer].passes)  # each view has one of that name
    added = [name for name in names if name in pass_table.REFERENCE_NAMES and name not in aovs]
    for name in added:
        aovs.add().name = name
    try:
        yield
    finally:
        if is_kept:
            aovs = depsgraph.view_layer_eval.aovs  # motion blur evaluates the scene anew
            for name in added:
                if name in aovs:
                    aovs.remove(aovs[name])


@contextmanager
def _session(engine: bpy.types.RenderEngine):
    """Cycles' own functions, with a session of `engine` inside."""
    with _cycles_errors():
        import cycles.engine as cycles_engine
        engine.session = None
        cycles_engine.create(engine, bpy.data)
    try:
        yield cycles_engine
    finally:
        with _cycles_errors():
            cycles_engine.free(engine)
        engine.session = None


def _read(result: bpy.types.RenderResult, layer: str, requested: list[pass_table.Pass],
          denoised: bool) -> dict[str, Passes]:
    height, width = result.resolution_y, result.resolution_x
    keys, noisy = {p.blender_name: p.key for p in requested}, pass_table.NOISY.blender_name
    if not denoised and any(p.name == noisy for p in result.layers[layer].passes):
        keys |= {noisy: "combined", "Combined": ""}  # Cycles then writes its picture under this name alone
    views = [view.name for view in result.views]
    read = {view: {} for view in views}
    for p in result.layers[layer].passes:
        of_view = read[views[p.view_id]]
        if keys.get(p.name) and keys[p.name] not in of_view:
            pixels = np.empty(height * width * p.channels, np.float32)
            p.rect.foreach_get(pixels)
            of_view[keys[p.name]] = pixels.reshape(height, width, p.channels)[::-1].copy()
    return read
