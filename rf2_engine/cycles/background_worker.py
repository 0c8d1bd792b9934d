# SPDX-License-Identifier: GPL-3.0-or-later
"""The program of background.py: Cycles renders one view layer of a copy, with all passes in one EXR file.

    blender --background --python background_worker.py -- COPY.blend JOB.json PASSES.exr
    python background_worker.py -- COPY.blend JOB.json PASSES.exr        # with the bpy module

It uses only the module compat of the add-on.
"""
import json
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable
from pathlib import Path

import bpy

import mathutils

sys.path.append(str(Path(__file__).parents[1]))
import compat  # noqa: E402  it lies in the folder above


def main() -> None:
    copy, request, answer = sys.argv[sys.argv.index("--") + 1:]
    job = json.loads(Path(request).read_text())
    bpy.ops.wm.open_mainfile(filepath=copy, load_ui=False, use_scripts=False)
    bpy.app.handlers.render_stats.append(_print_status)
    scene = bpy.data.scenes[job["scene"]]
    choose_devices(job["compute_device_type"], job["devices"])
    _prepare(scene, job)
    for collection, name, is_linked, path, value in job["changes"]:
        for data in getattr(bpy.data, collection):
            if data.name == name and (data.library is not None) == is_linked:
                if path == "matrix_world":
                    _hold_in_place(data)
                    value = mathutils.Matrix(value)
                parent, _, last = path.rpartition(".")
                setattr(data.path_resolve(parent) if parent else data, last, value)
    if bpy.app.binary_path:
        threading.Thread(target=_end_on_request, daemon=True).start()
    bpy.ops.render.render(scene=scene.name)
    settings = scene.render.image_settings
    compat.set_file_format(settings, "OPEN_EXR_MULTILAYER")
    settings.color_management, settings.color_depth, settings.exr_codec = "FOLLOW_SCENE", "32", "NONE"
    image = next(image for image in bpy.data.images if image.type == "RENDER_RESULT")
    image.save_render(answer, scene=scene)


def _prepare(scene: bpy.types.Scene, job: dict) -> None:
    """Render this view layer alone, cut to its border, without compositing."""
    settings = scene.render
    settings.engine, settings.use_compositing, settings.use_sequencer = "CYCLES", False, False
    settings.use_crop_to_border, settings.use_single_layer, settings.use_persistent_data = True, False, False
    settings.use_multiview = False
    for layer in scene.view_layers:
        layer.use = layer.name == job["layer"]
    layer = scene.view_layers[job["layer"]]
    layer.use_pass_combined = True
    for _, path in job["passes"]:
        if path:
            owner, _, name = path.rpartition(".")
            setattr(getattr(layer, owner) if owner else layer, name, True)
    scene.frame_set(job["frame"], subframe=job["subframe"])


def _hold_in_place(thing: bpy.types.Object) -> None:
    """Remove all that moves an object, so that its matrix can be set."""
    thing.animation_data_clear()
    thing.constraints.clear()
    thing.parent = None


def choose_devices(kind: str, devices: list[str]) -> None:
    """Set the devices of the user's preferences, which this Blender does not read."""
    preferences = bpy.context.preferences.addons["cycles"].preferences
    if kind != "NONE":
        preferences.compute_device_type = kind
        preferences.refresh_devices()
        for device in preferences.devices:
            device.use = device.id in devices


def run(program: Callable[[], None]) -> None:
    """Run a program to its end; the bpy module does not come back from this."""
    status = 1
    try:
        program()
        status = 0
    finally:
        if not bpy.app.binary_path:  # the exit handlers of the bpy module can hang
            if status:
                traceback.print_exc()
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(status)


def _end_on_request() -> None:
    """Blender's own handler of this signal ends a render in the background as Esc would."""
    if os.read(0, 1):  # and not sys.stdin: a thread that waits for that keeps Python from ending
        signal.raise_signal(signal.SIGINT)


def _print_status(status=None, *_) -> None:
    if isinstance(status, str):  # before Blender 5 it prints the status itself
        print(status, flush=True)


if __name__ == "__main__":
    run(main)
