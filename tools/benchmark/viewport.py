# SPDX-License-Identifier: GPL-3.0-or-later
"""Seconds until a Rendered viewport shows something, and how long its thread keeps Python's lock from the window.

    python -m tools.benchmark.viewport [SCENE.blend] [--size 960x540] [--budgets 2048,4096] [--rounds 3]
                                     [--finest 1]

Without a file: the cube, lamp and world that Blender starts with. Prints CSV, a row for each budget and kind of change:
`enter` (the first round loads PyTorch and is left out), `move` (an object), `camera`. `read` is what Blender's window
waits for, `8`, `4`, `2`, `1` are the seconds from the change to the picture of that resolution, `lock` is the longest
that another thread waited for Python's lock: Blender's window needs it to draw panels. Medians of the rounds, but the
largest of `lock`.
"""
from __future__ import annotations

import argparse
import csv
import statistics
import time
from collections.abc import Iterator
from pathlib import Path

from tools import extension
from tools.common.console import numbers, reserve_stdout
from tools.common.viewport import read_camera_pose, request_picture

LEVELS = (8, 4, 2, 1)
COLUMNS = ("budget", "change", "triangles", "read", *LEVELS, "lock")
STEP = 0.001  # seconds that the window, which this thread plays, sleeps


def main() -> int:
    arguments = _parse_arguments()
    answer = reserve_stdout()
    extension.load().register()
    import bpy

    from tools.common.scene_file import open_scene
    if arguments.scene:
        open_scene(arguments.scene)
    scene = bpy.context.scene
    scene.render.engine = "RENDERFORMER_V2"
    scene.renderformer_v2.viewport.time_limit, scene.renderformer_v2.viewport.resolution = 0, arguments.finest
    rows = csv.DictWriter(answer, COLUMNS)
    rows.writeheader()
    for budget in arguments.budgets:
        scene.renderformer_v2.viewport.token_budget = budget
        for row in _Viewport(scene, arguments.size).measure(arguments.rounds):
            rows.writerow({"budget": budget} | {key: f"{value:.3f}" if isinstance(value, float) else value
                                                for key, value in row.items()})
            answer.flush()
    return 0


def _parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tools.benchmark.viewport", description=__doc__.splitlines()[0])
    parser.add_argument("scene", type=Path, nargs="?")
    parser.add_argument("--size", type=lambda text: tuple(map(int, text.split("x"))), default=(960, 540))
    parser.add_argument("--budgets", type=numbers, default=(2048, 4096))
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--finest", choices=list(map(str, LEVELS)), default="1",
                        help="what pixels are divided by in the finest picture, whose light is that of a render")
    return parser.parse_args()


class _Viewport:
    """One viewport that looks through the scene's camera."""

    def __init__(self, scene, size: tuple[int, int]) -> None:
        self.scene, self.size, self.shift = scene, size, 0.0

    def measure(self, rounds: int) -> Iterator[dict]:
        """A row for each kind of change."""
        self._open()
        self._time_pictures()  # PyTorch is loaded
        for change, apply in (("enter", self._open), ("move", self._move_object), ("camera", self._move_camera)):
            timings = []
            for _ in range(rounds):
                apply()
                timings.append(self._time_pictures())
            yield {"change": change, "triangles": self.session.displayed.triangles,
                   "lock": max(timing["lock"] for timing in timings)} | {
                key: statistics.median(timing[key] for timing in timings)
                for key in ("read", *LEVELS) if key in timings[0]}

    def _open(self) -> None:
        from renderformer_v2.rf2_engine.runtime.worker import worker
        from renderformer_v2.rf2_engine.viewport.session import Session
        from renderformer_v2.rf2_engine.viewport.source import Source
        self.session, self.source = Session(), Source()
        worker.add(self.session)

    def _move_object(self) -> None:
        import bpy
        moved = next(obj for obj in self.scene.objects if obj.type == "MESH")
        moved.location.x += 0.05
        bpy.context.view_layer.update()
        self.source.changes.add(bpy.context.evaluated_depsgraph_get())
        self.source.changes.anything = True  # in a window, handlers would say so

    def _move_camera(self) -> None:
        self.shift += 0.02

    def _time_pictures(self) -> dict:
        """Seconds by COLUMNS from now until the finest picture."""
        import bpy

        from renderformer_v2.rf2_engine.runtime.worker import worker
        depsgraph, begin = bpy.context.evaluated_depsgraph_get(), time.perf_counter()
        while not self.source.refresh(depsgraph):
            pass
        timing = {"read": time.perf_counter() - begin, "lock": 0.0}
        pose = read_camera_pose(self.scene, depsgraph)
        pose[:3, 3] += self.shift * pose[:3, 0]
        self.session.submit(request_picture(self.scene, depsgraph, self.source, self.size, pose, begin))
        worker.wake()
        before, last = self.session.displayed, time.perf_counter()
        while self.session.has_work() or not worker.wait_until_idle(0):
            time.sleep(STEP)
            now, shown = time.perf_counter(), self.session.displayed
            timing["lock"], last = max(timing["lock"], now - last - STEP), now
            if shown is not None and shown is not before:
                timing[shown.divisor], before = shown.seconds, shown
        if self.session.error:
            raise RuntimeError(self.session.error)
        first = next(level for level in LEVELS if level in timing)  # coarser ones are not drawn where this is quick
        return {level: timing[first] for level in LEVELS if level > first} | timing


if __name__ == "__main__":
    extension.run(main)
