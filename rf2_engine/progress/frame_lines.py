# SPDX-License-Identifier: GPL-3.0-or-later
"""One line of JSON for each frame, for farms: what was rendered, in what time, or why not.

The environment variable RENDERFORMER_V2_FRAMES names the file that lines are appended to, or is "-" for Blender's
output. docs/farm.md lists the keys.
"""
from __future__ import annotations

import json
import os
import sys
import time
from dataclasses import dataclass

import bpy
from bpy.app.handlers import persistent

from ..frame_settings import threads
from ..registering import handlers
from ..runtime.running import ENGINE
from . import last_render, memory

VARIABLE = "RENDERFORMER_V2_FRAMES"
LOST = "Blender did not begin this frame, or another program ended it: see its output"
UNSAVED = "Blender could not save the picture, or another program ended it: see its output"


@dataclass
class OpenFrame:
    """The frame that has no line yet. There is one: `open_frame`."""

    begin: float | None = None  # by time.perf_counter; None: no frame is open
    number: int | None = None   # None before the first frame, and a render may skip all

    def start(self, number: int | None) -> None:
        self.begin, self.number = time.perf_counter(), number

    def end(self, scene: bpy.types.Scene, is_cancelled: bool) -> None:
        """Write the frame's line if the environment asks for lines."""
        if self.begin is not None and os.environ.get(VARIABLE) and scene.render.engine == ENGINE:
            if is_cancelled or self.number is not None:
                write(describe_frame(scene, self.number, time.perf_counter() - self.begin, is_cancelled))
        self.begin = None


open_frame = OpenFrame()


def describe_layer(layer: last_render.LayerStatistics) -> dict:
    """What a line holds about a view layer that was rendered."""
    keys = ("layer", "size", "triangles", "tokens", "weights", "device", "report", "reference_samples")
    return {key: getattr(layer, key) for key in keys} | {
        "seconds": {stage: round(seconds, 3) for stage, seconds in layer.seconds.items()}}


def describe_frame(scene: bpy.types.Scene, frame: int | None, seconds: float, is_cancelled: bool) -> dict:
    """What a line holds; is_cancelled: Blender ended the render early."""
    layers = last_render.last_frame
    errors = [f"{layer.layer}: {layer.error}" for layer in layers if layer.error]
    by_user = any(layer.cancelled for layer in layers)
    if is_cancelled and not (errors or by_user):
        errors = [UNSAVED if layers else LOST]
    return {"blend": bpy.data.filepath, "scene": scene.name, "frame": frame,
            "state": "failed" if errors else "cancelled" if by_user else "done", "errors": errors,
            "seconds": round(seconds, 3), "threads": threads(scene), "memory_mib": round(memory.measure()[1]),
            "process": os.getpid(), "layers": [describe_layer(layer) for layer in layers
                                               if not (layer.error or layer.cancelled)]}


def write(line: dict) -> None:
    """Append a line to what the environment names. A file that cannot be written is reported and ends nothing."""
    target, text = os.environ[VARIABLE], json.dumps(line) + "\n"
    if target == "-":
        sys.stdout.write(text)
        sys.stdout.flush()
        return
    try:
        with open(target, "a", encoding="utf-8") as file:  # one call for the line: other processes may write there
            file.write(text)
    except OSError as error:
        print(f"RenderFormer-V2: {VARIABLE}: {target} cannot be written: {error.strerror}", file=sys.stderr)


@persistent
def _start_render(*_):
    open_frame.start(None)


@persistent
def _start_frame(scene, *_):
    open_frame.start(scene.frame_current)  # noted now: a cancelled render leaves another one


@persistent
def _end_frame(scene, *_):
    open_frame.end(scene, is_cancelled=False)


@persistent
def _cancel(scene, *_):
    open_frame.end(scene, is_cancelled=True)


register, unregister = handlers(("render_init", _start_render), ("render_pre", _start_frame),
                                ("render_write", _end_frame), ("render_complete", _end_frame),
                                ("render_cancel", _cancel))
