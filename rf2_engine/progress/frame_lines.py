# SPDX-License-Identifier: GPL-3.0-or-later
"""One line of JSON for each frame, for whoever runs many of them: what was rendered, in what time, or why not.

The environment variable RENDERFORMER_V2_FRAMES names the file that lines are appended to, or is "-" for Blender's
output (docs/farm.md lists what they hold).
"""
from __future__ import annotations

import json
import os
import sys
import time

import bpy
from bpy.app.handlers import persistent

from ..registering import handlers
from ..runtime.running import ENGINE
from ..settings import threads
from . import last_render, memory

VARIABLE = "RENDERFORMER_V2_FRAMES"
LOST = "Blender did not begin this frame, or another program ended it: see its output"
UNSAVED = "Blender could not save the picture, or another program ended it: see its output"

_begun: float | None = None  # when the frame that has no line yet began; seconds of a clock
_frame: int | None = None    # its number; None before the first one, and a render may skip all


def of_layer(layer: last_render.LayerStatistics) -> dict:
    """What is known of a view layer that was rendered."""
    keys = ("layer", "size", "triangles", "tokens", "weights", "device", "report", "reference_samples")
    return {key: getattr(layer, key) for key in keys} | {
        "seconds": {stage: round(seconds, 3) for stage, seconds in layer.seconds.items()}}


def of_frame(scene: bpy.types.Scene, frame: int | None, seconds: float, ended: bool) -> dict:
    """What a line holds; `ended`: Blender says that the render ended before its time."""
    layers = last_render.last_frame
    errors = [f"{layer.layer}: {layer.error}" for layer in layers if layer.error]
    cancelled = any(layer.cancelled for layer in layers)
    if ended and not (errors or cancelled):
        errors = [UNSAVED if layers else LOST]
    return {"blend": bpy.data.filepath, "scene": scene.name, "frame": frame,
            "state": "failed" if errors else "cancelled" if cancelled else "done", "errors": errors,
            "seconds": round(seconds, 3), "threads": threads(scene), "memory_mib": round(memory.held()[1]),
            "process": os.getpid(), "layers": [of_layer(layer) for layer in layers
                                               if not (layer.error or layer.cancelled)]}


def write(line: dict) -> None:
    """Append a line where the environment wants it. A file that cannot be written is said, and ends nothing."""
    where, text = os.environ[VARIABLE], json.dumps(line) + "\n"
    if where == "-":
        sys.stdout.write(text)
        sys.stdout.flush()
        return
    try:
        with open(where, "a", encoding="utf-8") as file:  # one call for one line: others may write there too
            file.write(text)
    except OSError as error:
        print(f"RenderFormer-V2: {VARIABLE}: {where} cannot be written: {error.strerror}", file=sys.stderr)


@persistent
def _initialize(*_):
    global _begun, _frame
    _begun, _frame = time.perf_counter(), None


@persistent
def _begin(scene, *_):
    global _begun, _frame
    _begun, _frame = time.perf_counter(), scene.frame_current  # which is another one when the render was cancelled


def _end(scene: bpy.types.Scene, ended: bool) -> None:
    global _begun
    if _begun is not None and os.environ.get(VARIABLE) and scene.render.engine == ENGINE:
        if ended or _frame is not None:
            write(of_frame(scene, _frame, time.perf_counter() - _begun, ended))
    _begun = None


@persistent
def _done(scene, *_):
    _end(scene, False)


@persistent
def _cancelled(scene, *_):
    _end(scene, True)


register, unregister = handlers(("render_init", _initialize), ("render_pre", _begin), ("render_write", _done),
                                ("render_complete", _done), ("render_cancel", _cancelled))
