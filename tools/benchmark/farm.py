# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m tools.benchmark.farm: frames a minute of this machine by the number of processes, and what a frame costs.

    python -m tools.benchmark.farm [--scene FILE.blend] [--processes 1,2,4] [--frames 5] [--blender COMMAND]
                                   [--total 10000 --machines 100]

So many processes at once render their own frames, each with an equal share of the cores as its threads. Without --scene
it is the scene of tools.benchmark, 16,384 triangles and 512x512 pixels, round which the camera moves. --blender takes
an installed Blender with the add-on enabled instead of Blender's Python package. Prints one JSON object: for each
number of processes the seconds to start, of the first frame and of later ones, and memory; the machine's seconds for a
frame, by how many frames a process renders; and the hours of --total frames on --machines such machines, likewise.
"""
from __future__ import annotations

import argparse
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

from tools.common.console import numbers, whole_number
from tools.extension import ROOT

from .load import count_cores

TASKS = (1, 2, 5, 10, 25, 100)  # frames of a task
SAVE_SCENE = """
import sys
sys.path.insert(0, sys.argv[1])
import bpy
from tools import extension
extension.load().register()
from tools.benchmark import ring
triangles, resolution, frames = map(int, sys.argv[3:])
ring.build(triangles, resolution)
scene = bpy.context.scene
scene.render.engine = "RENDERFORMER_V2"
scene.renderformer_v2.token_budget, scene.frame_end = triangles, frames
turn = bpy.data.objects.new("Turn", None)
scene.collection.objects.link(turn)
scene.camera.parent = turn
for turn.rotation_euler.z, frame in ((0, 1), (6.28, 10000)):
    turn.keyframe_insert("rotation_euler", frame=frame)
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[2])
extension.leave(0)
"""


@dataclass(frozen=True)
class FrameCosts:
    """What frames cost with `processes` at once; seconds are medians, memory is the most of any."""

    processes: int
    threads: int       # of each
    start: float       # without the frames: Blender, the file, and its end
    first: float       # with PyTorch and the weights
    later: float
    memory_mib: float
    frames_per_minute: float  # of all together, by what later frames take
    core_seconds: float       # that a frame kept a core busy, start and first frames included; 0 on Windows

    def task_seconds(self, frames: int) -> float:
        """Seconds of a process that renders this number of frames."""
        return self.start + self.first + (frames - 1) * self.later

    def machine_seconds(self, frames: int) -> float:
        """The machine's seconds for a frame, if each process renders this number of frames."""
        return self.task_seconds(frames) / frames / self.processes

    def job_hours(self, total: int, machines: int, frames: int) -> float:
        """Hours of a job of equal tasks, each of `frames` frames; the last ones leave machines idle."""
        rounds = math.ceil(math.ceil(total / frames) / (machines * self.processes))
        return rounds * self.task_seconds(frames) / 3600


def measure(command: list[str], file: Path, processes: int, frames: int, folder: Path) -> FrameCosts:
    """Raises subprocess.CalledProcessError for a process that failed."""
    threads = max(1, count_cores() // processes)

    def render_part(i: int) -> tuple[float, list[dict]]:
        lines, begin = folder / f"{processes}-{i}.jsonl", time.perf_counter()
        subprocess.run([*command, "-b", file, "-t", str(threads), "-o", folder / f"{processes}-####", "-s",
                        str(1 + i * frames), "-e", str((i + 1) * frames), "-a"], check=True, capture_output=True,
                       text=True, env=os.environ | {"RENDERFORMER_V2_FRAMES": str(lines)})
        seconds = time.perf_counter() - begin
        return seconds, [json.loads(line) for line in lines.read_text(encoding="utf-8").splitlines()]

    before = os.times()
    with ThreadPoolExecutor(processes) as pool:
        parts = list(pool.map(render_part, range(processes)))
    after = os.times()
    busy = after.children_user + after.children_system - before.children_user - before.children_system
    start = statistics.median(seconds - sum(line["seconds"] for line in lines) for seconds, lines in parts)
    first = statistics.median(lines[0]["seconds"] for _, lines in parts)
    later = statistics.median(line["seconds"] for _, lines in parts for line in lines[1:])
    return FrameCosts(processes, threads, start, first, later, max(lines[-1]["memory_mib"] for _, lines in parts),
                      60 * processes / later, busy / (processes * frames))


def summarize(rows: list[FrameCosts], total: int, machines: int) -> dict:
    return {"measured": [{name: round(value, 2) for name, value in asdict(row).items()} for row in rows],
            "machine_seconds_per_frame": {
                row.processes: {n: round(row.machine_seconds(n), 2) for n in TASKS} for row in rows},
            "job": {"frames": total, "machines": machines, "hours": {
                row.processes: {n: round(row.job_hours(total, machines, n), 2) for n in TASKS} for row in rows}}}


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.benchmark.farm", description=__doc__.splitlines()[0])
    parser.add_argument("--scene", type=Path)
    parser.add_argument("--triangles", type=whole_number(258), default=16384, help="of the scene without --scene")
    parser.add_argument("--resolution", type=whole_number(16), default=512, help="of the scene without --scene")
    parser.add_argument("--processes", type=numbers, default=(1, 2, 4))
    parser.add_argument("--frames", type=whole_number(2), default=5, help="of each process (default 5)")
    parser.add_argument("--blender", type=str.split, metavar="COMMAND")
    parser.add_argument("--total", type=whole_number(1), default=10000)
    parser.add_argument("--machines", type=whole_number(1), default=100)
    options = parser.parse_args()
    command = options.blender or [sys.executable, "-m", "tools.blender_command"]
    with tempfile.TemporaryDirectory() as folder:
        file = options.scene and options.scene.resolve()
        try:
            if not file:
                file = Path(folder) / "ring.blend"
                subprocess.run([sys.executable, "-c", SAVE_SCENE, ROOT, file, str(options.triangles),
                                str(options.resolution), str(options.frames)], check=True, capture_output=True,
                               text=True)
            os.chdir(ROOT)
            rows = [measure(command, file, count, options.frames, Path(folder)) for count in options.processes]
        except subprocess.CalledProcessError as error:
            print(error.stdout + error.stderr, file=sys.stderr)
            return 1
    load = {"load_average": os.getloadavg()[0]} if hasattr(os, "getloadavg") else {}
    print(json.dumps(summarize(rows, options.total, options.machines) | load))
    return 0


if __name__ == "__main__":
    sys.exit(main())
