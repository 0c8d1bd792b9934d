# SPDX-License-Identifier: GPL-3.0-or-later
"""Run Cycles in a Blender of its own, in the background, if it cannot be run inside our engine.

It renders a temporary copy of the scene: the user's file, preferences and online access are not touched.
"""
from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import threading
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import bpy
import numpy as np

import mathutils

from ...model import progress
from ...model.errors import RenderCancelled, SceneError
from .. import exr, main_thread
from .. import passes as pass_table
from ..progress import cycles_text
from ..runtime import running

INTERVAL = 0.1  # seconds between two checks of the Esc key
GRACE = 30.0    # seconds that a Blender has to hand over its samples
STOP = b"stop\n"
WORKER = Path(__file__).with_name("background_worker.py")
COLLECTIONS = {"SCENE": "scenes", "OBJECT": "objects", "WORLD": "worlds", "CAMERA": "cameras",
               "NODETREE": "node_groups"}


@dataclass
class Job:
    """A render of one view layer. Made before Cycles runs inside Blender, which may free the evaluated scene."""

    scene: str
    layer: str
    frame: int
    subframe: float
    passes: list[tuple[str, str]]                               # Blender's name, path of the setting that enables it
    changes: list[tuple[str, str, bool, str, object]] = field(default_factory=list)  # see `describe_change`
    compute_device_type: str = "NONE"
    devices: list[str] = field(default_factory=list)            # Cycles' names of those that are switched on

    @classmethod
    def create(cls, depsgraph: bpy.types.Depsgraph, layer: str, requested: list[pass_table.Pass], changes: list) -> Job:
        scene = depsgraph.scene_eval
        job = cls(scene.original.name, layer, scene.frame_current, scene.frame_subframe,
                  [(p.blender_name, p.setting) for p in requested], list(changes))
        if cycles := bpy.context.preferences.addons.get("cycles"):
            job.compute_device_type = cycles.preferences.compute_device_type
            job.devices = [device.id for device in cycles.preferences.devices if device.use]
        return job


def describe_change(data: bpy.types.ID, path: str, value: object) -> tuple[str, str, bool, str, object]:
    """A setting of evaluated data: collection of bpy.data, name, whether it is linked, path, and value for JSON."""
    original = data.original
    if isinstance(value, mathutils.Matrix):
        value = [list(row) for row in value]
    elif not isinstance(value, (str, int, float)):
        value = list(value)
    return COLLECTIONS[original.id_type], original.name, original.library is not None, path, value


def run(engine: bpy.types.RenderEngine, job: Job, requested: list[pass_table.Pass],
        partial: bool = False) -> dict[str, np.ndarray]:
    """{key: (H, W, C) f32} of the `requested` passes, row 0 on top, of the render border.

    Esc ends that Blender and raises RenderCancelled; with `partial` the samples that it has are returned instead, and
    the last status of `engine` says how many these are. Raises SceneError when that Blender cannot be started or fails.
    """
    with tempfile.TemporaryDirectory(prefix="renderformer-v2-") as folder:
        answer = Path(folder) / "passes.exr"
        process = start_blender(WORKER, *write_copy(folder, bpy.data.scenes[job.scene], vars(job)), str(answer),
                                stdin=subprocess.PIPE)
        _wait(engine, process, partial and bool(bpy.app.binary_path))  # the bpy module cannot be interrupted
        try:
            file = exr.read(answer)
        except (OSError, ValueError) as error:
            raise SceneError(f"the background Blender rendered nothing that can be read: {error}") from error
    _stamp_cryptomatte(engine, file.metadata)
    return {p.key: _pixels(file.passes[job.layer, p.blender_name], p.channels)
            for p in requested if (job.layer, p.blender_name) in file.passes}


def write_copy(folder: str, scene: bpy.types.Scene, job: dict) -> tuple[str, str]:
    """Paths, in this folder, of a copy of the scene and of the job as JSON."""
    copy, request = Path(folder, "scene.blend"), Path(folder, "job.json")
    main_thread.call(lambda: bpy.data.libraries.write(str(copy), {scene}, path_remap="ABSOLUTE"))
    request.write_text(json.dumps(job))
    return str(copy), str(request)


def start_blender(worker: Path, *arguments: str, stdin: int = subprocess.DEVNULL) -> subprocess.Popen:
    """A Blender that runs a program beside this file; it prints to the pipe `stdout`. Raises SceneError."""
    try:
        return subprocess.Popen(_command(str(worker), *arguments), stdin=stdin, stdout=subprocess.PIPE,
                                stderr=subprocess.STDOUT, encoding="utf-8", errors="replace",
                                creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0))
    except (OSError, ValueError) as error:
        raise SceneError(f"a background Blender cannot be started ({error}): install Blender from blender.org, and "
                         "render there") from error


def _command(worker: str, *arguments: str) -> list[str]:
    """The command of a Blender; of the bpy module, which is no program, that of this Python."""
    if bpy.app.binary_path:
        return [bpy.app.binary_path, "--background", "--factory-startup", "--offline-mode", "--disable-autoexec",
                "--python-exit-code", "1", "--python", worker, "--", *arguments]
    return [sys.executable, worker, "--", *arguments]


def _wait(engine: bpy.types.RenderEngine, process: subprocess.Popen, partial: bool) -> None:
    """Wait until the process has ended, by itself or on request; reports Cycles' own progress."""
    lines = [""]
    reader = threading.Thread(target=lambda: lines.extend(process.stdout), daemon=True)
    reader.start()
    try:
        try:
            while reader.is_alive():
                reader.join(INTERVAL)
                status = _status(lines)
                progress.report(cycles_text.fraction(status), status or "Starting a background Blender")
        except RenderCancelled:
            if not partial or running.is_stopping():
                raise
            if not _hand_over(engine, process, reader):
                raise RenderCancelled("the Blender in the background did not hand over its samples in "
                                      f"{GRACE:.0f} seconds") from None
            engine.update_stats("", _status(lines))
            return  # the exit status is that of a render that was ended; the file shows whether it had samples
        code = process.wait()
    finally:
        process.kill()
        process.wait()
        reader.join()
        process.stdout.close()
        with suppress(OSError):
            process.stdin.close()
    if code:
        print("".join(lines))
        last = next((line.strip() for line in reversed(lines) if line.strip()), f"it ended with code {code}")
        raise SceneError(f"the background Blender failed: {last}. See the console; Cycles must work in this Blender, "
                         "so install it again from blender.org")


def _status(lines: list[str]) -> str:
    """The last line of Cycles about its samples, or ""."""
    line = next((line for line in reversed(lines) if "Sample" in line), "").strip()
    return line and f"Background Blender {line[line.find('Sample'):]}"


def _hand_over(engine: bpy.types.RenderEngine, process: subprocess.Popen, reader: threading.Thread) -> bool:
    """Ask the process to end with what it has rendered; returns whether it did in time."""
    try:
        process.stdin.write(STOP.decode())
        process.stdin.flush()
    except OSError:
        pass  # it has just ended
    engine.update_stats("", "Background Blender finishes the samples that it has begun")
    reader.join(GRACE)
    return not reader.is_alive()


def _pixels(channels: dict[str, np.ndarray], order: str) -> np.ndarray:
    by_name = {name.lower(): pixels for name, pixels in channels.items()}
    ordered = [by_name[name] for name in order.lower() if name in by_name]
    if len(ordered) != len(order):  # a value is called V in some versions and X in others
        ordered = list(channels.values())
    return np.stack(ordered, -1).astype(np.float32)


def _stamp_cryptomatte(engine: bpy.types.RenderEngine, metadata: dict[str, str]) -> None:
    for key, value in metadata.items():
        if key.startswith("cryptomatte/"):
            engine.get_result().stamp_data_add_field(key, value)
