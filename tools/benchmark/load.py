# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m tools.benchmark.load SCENE.blend: seconds of F12 beside busy programs, against an idle machine.

    python -m tools.benchmark.load SCENE.blend [--busy 0,1,2] [--repeats N] [--threads N] [--blender COMMAND]

Each render is a process of its own, in turn beside 0, 1 and 2 programs that never rest. --blender takes an installed
Blender with the add-on enabled instead of Blender's Python package. Prints one JSON object: the median seconds of each
stage, how many times those of the smallest load they are, and what would be fair: the cores over this program's share
of them. With GOMP_SPINCOUNT=300000 in the environment threads spin while they wait, as they do without the add-on.
"""
from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from contextlib import contextmanager

from tools.common.console import numbers
from tools.extension import ROOT

IN_BLENDER = """
import json, sys, bpy
from bl_ext.user_default.renderformer_v2.rf2_engine.progress.last_render import last_frame
scene, threads = bpy.context.scene, int(sys.argv[-1])
scene.render.engine, scene.render.threads_mode = "RENDERFORMER_V2", "FIXED" if threads else "AUTO"
if threads:
    scene.render.threads = threads
bpy.ops.render.render()
print(json.dumps({"seconds": last_frame[0].seconds}))
"""


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.benchmark.load", description=__doc__.splitlines()[0])
    parser.add_argument("scene")
    parser.add_argument("--busy", type=numbers, default=(0, 1, 2))
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--threads", type=int, default=0, help="of the render (default: all)")
    parser.add_argument("--blender", type=str.split, metavar="COMMAND")
    arguments = parser.parse_args()
    measured = {count: [] for count in sorted(arguments.busy)}
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(arguments.repeats):  # in turn, so that what else happens on the machine meets all alike
            for count in measured:
                with busy_programs(count):
                    measured[count].append(time_stages(build_command(arguments, folder)))
    print(json.dumps(summarize(measured) | {"threads": arguments.threads, "load_average": os.getloadavg()[0]}))
    return 0


def count_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def busy_programs(programs: int):
    """Run a number of processes that never rest."""
    running = [subprocess.Popen([sys.executable, "-c", "while 1: pass"]) for _ in range(programs)]
    try:
        yield
    finally:
        for process in running:
            process.kill()
            process.wait()


def build_command(arguments: argparse.Namespace, folder: str) -> list[str]:
    if arguments.blender:
        return [*arguments.blender, "-b", arguments.scene, "--python-exit-code", "1", "--python-expr", IN_BLENDER,
                "--", str(arguments.threads)]
    threads = ["--threads", str(arguments.threads)] if arguments.threads else []
    return [sys.executable, "-m", "tools.render", arguments.scene, "-o", f"{folder}/picture.png", *threads]


def time_stages(render: list[str]) -> dict[str, float]:
    """Seconds by stage of one render. Raises RuntimeError with its last words."""
    finished = subprocess.run(render, cwd=ROOT, capture_output=True, text=True)
    answers = [line for line in finished.stdout.splitlines() if line.startswith("{")]
    if finished.returncode or not answers:
        raise RuntimeError((finished.stderr.strip().splitlines() or ["no answer"])[-1])
    return json.loads(answers[-1])["seconds"]


def summarize(measured: dict[int, list[dict[str, float]]]) -> dict:
    """Medians and ratios of the stages of every render, by the number of busy programs."""
    cores = count_cores()
    median = {count: {stage: round(statistics.median(seconds[stage] for seconds in renders), 3) for stage in renders[0]}
              for count, renders in measured.items()}
    idle = median[min(median)]
    return {"cores": cores, "seconds": median,
            "times": {count: {stage: round(seconds[stage] / idle[stage], 2) for stage in idle if idle[stage]}
                      for count, seconds in median.items()},
            "fair": {count: round(max(1.0, (cores + count) / cores), 2) for count in measured},
            "network": {count: sorted(round(s["Network"], 3) for s in renders) for count, renders in measured.items()}}


if __name__ == "__main__":
    sys.exit(main())
