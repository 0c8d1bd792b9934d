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
import os
import statistics
import time
from pathlib import Path

import numpy as np

from tools import extension
from tools.common.arguments import numbers

LEVELS = (8, 4, 2, 1)
COLUMNS = ("budget", "change", "triangles", "read", *LEVELS, "lock")
STEP = 0.001  # seconds that the window, which this thread plays, sleeps


def main() -> int:
    arguments = _arguments()
    answer = os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # Blender's talk is not the answer
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
        for row in _Viewport(scene, arguments.size).measured(arguments.rounds):
            rows.writerow({"budget": budget} | {key: f"{value:.3f}" if isinstance(value, float) else value
                                                for key, value in row.items()})
            answer.flush()
    return 0


def _arguments() -> argparse.Namespace:
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
        self.scene, self.size, self.turn = scene, size, 0.0

    def measured(self, rounds: int):
        self._begin()
        self._seconds()  # PyTorch is loaded
        for change, make in (("enter", self._begin), ("move", self._move), ("camera", self._look_elsewhere)):
            found = []
            for _ in range(rounds):
                make()
                found.append(self._seconds())
            yield {"change": change, "triangles": self.session.shown.triangles,
                   "lock": max(each["lock"] for each in found)} | {
                key: statistics.median(each[key] for each in found) for key in ("read", *LEVELS) if key in found[0]}

    def _begin(self) -> None:
        from renderformer_v2.rf2_engine.runtime.worker import worker
        from renderformer_v2.rf2_engine.viewport.session import Session
        from renderformer_v2.rf2_engine.viewport.source import Source
        self.session, self.source = Session(), Source()
        worker.add(self.session)

    def _move(self) -> None:
        import bpy
        moved = next(obj for obj in self.scene.objects if obj.type == "MESH")
        moved.location.x += 0.05
        bpy.context.view_layer.update()
        self.source.changes.add(bpy.context.evaluated_depsgraph_get())
        self.source.changes.anything = True  # the handlers of the window have seen it already

    def _look_elsewhere(self) -> None:
        self.turn += 0.02

    def _seconds(self) -> dict:
        import bpy

        from renderformer_v2.rf2_engine.runtime.worker import worker
        from renderformer_v2.rf2_engine.viewport.lighting import Look
        from renderformer_v2.rf2_engine.viewport.session import Request
        depsgraph, begin = bpy.context.evaluated_depsgraph_get(), time.perf_counter()
        while not self.source.refresh(depsgraph):
            pass
        found = {"read": time.perf_counter() - begin, "lock": 0.0}
        self.session.ask(Request(self.source.copied, self.source.state, self._view(depsgraph),
                                 Look.of(self.scene, depsgraph.view_layer), begin))
        worker.wake()
        before, last = self.session.shown, time.perf_counter()
        while self.session.wants() or not worker.wait_until_idle(0):
            time.sleep(STEP)
            now, shown = time.perf_counter(), self.session.shown
            found["lock"], last = max(found["lock"], now - last - STEP), now
            if shown is not None and shown is not before:
                found[shown.divisor], before = shown.seconds, shown
        if self.session.error:
            raise RuntimeError(self.session.error)
        first = next(level for level in LEVELS if level in found)  # coarser ones are left out where this is quick
        return {level: found[first] for level in LEVELS if level > first} | found

    def _view(self, depsgraph):
        from renderformer_v2.rf2_engine.viewport.region_view import RegionView
        camera, (width, height) = self.scene.camera.evaluated_get(depsgraph), self.size
        matrix = np.array(camera.matrix_world)
        matrix[:3, 3] += self.turn * matrix[:3, 0]
        projection = camera.calc_matrix_camera(depsgraph, x=width, y=height)
        return RegionView(tuple(map(tuple, projection)), tuple(map(tuple, matrix.tolist())), (0, width, 0, height),
                          self.size)


if __name__ == "__main__":
    extension.run(main)
