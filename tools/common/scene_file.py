# SPDX-License-Identifier: GPL-3.0-or-later
"""A .blend file: open it, set it up for one of the two engines, and save its picture."""
from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from renderformer_v2.model.weights.presets import BUNDLED

from .pictures import write_atomically
from .tone_mapping import VIEWS

FORMATS = {".exr": "OPEN_EXR_MULTILAYER", ".png": "PNG"}
LIGHTS = "TRACED", "NETWORK", "TRANSFORMER"  # of Light in Render Properties
ENGINES = {"renderformer": "RENDERFORMER_V2", "cycles": "CYCLES"}


def open_scene(path: Path):
    """The active scene of a .blend file. Raises ValueError when no view layer is enabled, RuntimeError as Blender."""
    import bpy
    bpy.ops.wm.open_mainfile(filepath=str(path.resolve()))
    scene = bpy.context.scene
    if not any(layer.use for layer in scene.view_layers):
        raise ValueError(f'no view layer of scene "{scene.name}" is enabled for rendering: '
                         "switch on Use for Rendering in View Layer Properties")
    return scene


@dataclass(frozen=True)
class RenderOptions:
    """How a scene is rendered; what is None stays as it is in the file."""

    engine: str                                # of ENGINES
    samples: int | None = None                 # of every pixel, by our engine or by Cycles
    resolution: tuple[int, int] | None = None
    weights: str | None = None                 # BUNDLED, or a folder
    threads: int | None = None
    light: str | None = None                   # of LIGHTS
    with_reference: bool = False               # beside a reference by Cycles
    reference_samples: int | None = None       # of that reference
    unclamped: bool = False                    # Cycles keeps light that has bounced as it is
    device: str | None = None                  # of the network, as model/renderer.py takes it
    precision: str | None = None               # likewise
    triangles: int | None = None               # at most
    tone_mapper: str | None = None             # of TONE_MAPPERS, for PNG files


def configure(scene, options: RenderOptions) -> None:
    """Choose an engine and its settings."""
    ours = scene.renderformer_v2
    scene.render.engine = ENGINES[options.engine]
    if options.samples:
        owner, name = (scene.cycles, "samples") if options.engine == "cycles" else (ours, "guide_samples")
        setattr(owner, name, options.samples)
        ours.use_adaptive_sampling = False
    if options.threads:
        scene.render.threads_mode, scene.render.threads = "FIXED", options.threads
        ours.threads_mode = "AUTO"  # Blender's
    if options.resolution:
        scene.render.resolution_x, scene.render.resolution_y = options.resolution
        scene.render.resolution_percentage = 100
    if options.weights:
        ours.weights_source = "BUNDLED" if options.weights == BUNDLED else "FOLDER"
        ours.weights_folder = os.path.abspath(options.weights)
    if options.with_reference:
        ours.reference.use = True
        if options.reference_samples:
            ours.reference.samples = options.reference_samples
    if options.unclamped:
        scene.cycles.sample_clamp_indirect = 0
    if options.triangles:
        ours.token_budget = options.triangles
    if options.device:
        kind, _, card = options.device.partition(":")
        ours.device, ours.card = kind, int(card) + 1 if card else 0
    if options.precision:
        ours.precision = options.precision
    if options.light:
        ours.light = options.light
    if options.tone_mapper:
        scene.view_settings.view_transform = VIEWS[options.tone_mapper]


def save_picture(path: Path, scene) -> None:
    """The last render as multilayer EXR in full floats, or as PNG, by suffix. Raises OSError naming `path`."""
    import bpy

    from renderformer_v2.rf2_engine.compat import set_file_format
    settings = scene.render.image_settings
    set_file_format(settings, FORMATS[path.suffix.lower()])
    if path.suffix.lower() == ".exr":
        settings.color_depth = "32"
    result = bpy.data.images["Render Result"]
    write_atomically(path, lambda file: result.save_render(str(file), scene=scene))
