# SPDX-License-Identifier: GPL-3.0-or-later
"""Bake nodes that only Cycles can evaluate, in a Blender of its own, on a temporary copy of the scene.

The copy is written and that Blender started at the first such node. It ends with the conversion.
"""
from __future__ import annotations

import json
import queue
import subprocess
import tempfile
import threading
from contextlib import suppress
from pathlib import Path

import bpy
import numpy as np

from ...model import progress
from ...model.errors import RenderCancelled, SceneError
from ...model.scene import TILE_SIZE
from . import background as background_cycles

WORKER = Path(__file__).with_name("bake_worker.py")
SAMPLES = 4     # of each texel
NOISY = {"ShaderNodeAmbientOcclusion": 16, "ShaderNodeBevel": 16}  # those that cast rays at random
SIDE = 16       # texels along the edges of a triangle


class Baker:
    """Bakes inside its context; no copy is written and no Blender started before `prepare` or `bake` is called."""

    def __init__(self, depsgraph: bpy.types.Depsgraph):
        job = background_cycles.Job.create(depsgraph, depsgraph.view_layer_eval.name, [], [])
        self._scene = depsgraph.scene_eval.original
        self._settings = {name: getattr(job, name) for name in (
            "scene", "layer", "frame", "subframe", "compute_device_type", "devices")}
        self._settings["device"] = depsgraph.scene_eval.cycles.device
        self._folder, self._process, self._reader, self._broken = None, None, None, ""
        self._lines: queue.Queue[str | None] = queue.Queue()

    def __enter__(self) -> Baker:
        return self

    def __exit__(self, *_) -> None:
        if self._process:
            self._process.kill()
            self._process.wait()
            with suppress(OSError):  # of what it has not read
                self._process.stdin.close()
            self._reader.join()
            self._process.stdout.close()
        if self._folder:
            self._folder.cleanup()

    def prepare(self) -> None:
        """Write the copy and start that Blender now instead of in `bake`. Raises RenderCancelled after Esc."""
        try:
            self._start()
        except RenderCancelled:
            raise
        except (OSError, ValueError, RuntimeError, SceneError) as error:
            self._broken = f"it could not be baked: {error}"

    def bake(self, n) -> np.ndarray:
        """(m, 32, 32, 1 or 3) f32 of the output of a NodeCall, on the triangles of its points.

        Raises RuntimeError with the reason when it cannot be baked, RenderCancelled after Esc.
        """
        if self._broken:
            raise RuntimeError(self._broken)
        what = f"{n.node.name} of {n.evaluator.owner}"
        try:
            with progress.part(0, 1, f"Baking {what}"):
                texels = self._baked(n)
        except RenderCancelled:
            raise
        except (OSError, ValueError, RuntimeError, SceneError) as error:
            self._broken = f"{what} could not be baked: {error}"
            raise RuntimeError(self._broken) from error
        if np.isnan(texels).all():
            raise RuntimeError("Cycles baked nothing on its triangles")
        values = _resized(_filled(texels))
        return values[..., :1] if n.output.type in ("VALUE", "INT", "BOOLEAN") else values

    def _baked(self, n) -> np.ndarray:
        if self._process is None:
            self._start()
        corners, answer = str(Path(self._folder.name, "corners.npy")), str(Path(self._folder.name, "answer.npy"))
        np.save(corners, n.points.corners)
        instance = n.points.instance
        what = {"object_name": instance.name, "matrix": instance.matrix.tolist(), "material_name": n.evaluator.owner,
                "groups": [group.name for group in n.frames], "node_name": n.node.name,
                "output": list(n.node.outputs).index(n.output), "triangles": corners, "side": SIDE,
                "samples": NOISY.get(n.kind, SAMPLES)}
        self._process.stdin.write(json.dumps({"what": what, "answer": answer}) + "\n")
        self._process.stdin.flush()
        self._wait_for("baked")
        return np.load(answer)

    def _start(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="renderformer-v2-")
        files = background_cycles.write_copy(self._folder.name, self._scene, self._settings)
        self._process = background_cycles.start_blender(WORKER, *files, stdin=subprocess.PIPE)
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        self._wait_for("ready")

    def _read(self) -> None:
        for line in self._process.stdout:
            self._lines.put(line.strip())
        self._lines.put(None)

    def _wait_for(self, word: str) -> None:
        output_lines = ["no message"]
        while True:
            progress.report()
            try:
                line = self._lines.get(timeout=background_cycles.INTERVAL)
            except queue.Empty:
                continue
            if line == word:
                return
            if line is None:
                print("\n".join(output_lines))
                raise RuntimeError(f"the background Blender ended: {output_lines[-1]}")
            output_lines += [line] if line else []


class UnavailableBaker:
    """Replaces a Baker where nothing is rendered."""

    def prepare(self) -> None:
        pass

    def bake(self, n):
        raise RuntimeError("it is baked only when rendering")


def _filled(tiles: np.ndarray) -> np.ndarray:
    """(m, s, s, c) tiles with NaN replaced by the texel mirrored at the diagonal, else by the mean of tile or all."""
    tiles = np.where(np.isnan(tiles), tiles[:, ::-1, ::-1].transpose(0, 2, 1, 3), tiles)
    baked = ~np.isnan(tiles)
    count = baked.sum(axis=(1, 2), keepdims=True)
    total = np.where(baked, tiles, 0).sum(axis=(1, 2), keepdims=True)
    mean = np.where(count > 0, total / np.maximum(count, 1), total.sum(axis=0) / count.sum(axis=0))
    return np.where(baked, tiles, mean).astype(np.float32)


def _resized(tiles: np.ndarray) -> np.ndarray:
    """(m, s, s, c) -> (m, 32, 32, c), linearly between the middles of texels."""
    at = np.clip((np.arange(TILE_SIZE) + 0.5) * tiles.shape[1] / TILE_SIZE - 0.5, 0, tiles.shape[1] - 1)
    low = np.minimum(at.astype(int), tiles.shape[1] - 2)
    part = np.float32(at - low)
    for axis in (1, 2):
        shape = [-1 if i == axis else 1 for i in range(4)]
        weight = part.reshape(shape)
        tiles = tiles.take(low, axis=axis) * (1 - weight) + tiles.take(low + 1, axis=axis) * weight
    return tiles
