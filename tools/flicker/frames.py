# SPDX-License-Identifier: GPL-3.0-or-later
"""The frames of one engine: rendered where they are missing, and read again."""
from __future__ import annotations

import hashlib
import json
import sys
import time
from pathlib import Path

import bpy

from renderformer_v2.model.weights.presets import weights_folder
from tools.exr import read_pass
from tools.scene_file import configure, open_scene, save

from .measure import Frame
from .orbit import views


def rendered(path: Path, output: Path, engine: str, frames: int, degrees: float, **settings) -> list[tuple]:
    """(View, file) of every frame; those that `output` holds already are not rendered again.

    settings: as tools.scene_file.configure takes them. Each way to render has a folder of its own in `output`, so that
    no frame is taken for another; the seconds of each are printed. Raises what Blender raises, SceneError when there is
    no usable camera, and OSError.
    """
    scene = open_scene(path)
    configure(scene, engine, **settings)
    scene.render.use_border = False
    for layer in scene.view_layers:
        layer.use_pass_position = True
    settings |= {"threads": None, "engine": engine, "frames": frames, "degrees": degrees, "scene": _digest(path)}
    if engine == "renderformer":
        weights = weights_folder(scene.renderformer_v2.weights())
        settings["weights"] = [_digest(file) for file in sorted(weights.glob("*.safetensors"))]
    text = json.dumps(settings, indent=1, sort_keys=True)
    folder = output / f"{engine}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "settings.json").write_text(text)
    found = []
    for number, view in enumerate(views(scene, frames, degrees), 1):
        file = folder / f"{number:04d}.exr"
        if not file.exists():
            begin = time.perf_counter()
            bpy.ops.render.render(scene=scene.name)
            print(f"{file}: {time.perf_counter() - begin:.1f} s", file=sys.stderr, flush=True)
            save(file, scene)
        found.append((view, file))
    return found


def read(view, file: Path) -> Frame:
    return Frame(view, read_pass(file, "Combined", "RGB"), read_pass(file, "Position", "XYZ"))


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()[:16]
