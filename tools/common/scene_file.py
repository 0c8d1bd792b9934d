# SPDX-License-Identifier: GPL-3.0-or-later
"""A .blend file: open it, set it up for one of the two engines, and save its picture."""
from __future__ import annotations

import os
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


def configure(scene, engine: str, *, samples: int | None = None, resolution: tuple[int, int] | None = None,
              weights: str | None = None, threads: int | None = None, light: str | None = None,
              with_reference: bool = False, reference_samples: int | None = None, unclamped: bool = False,
              device: str | None = None, precision: str | None = None, triangles: int | None = None,
              tone_mapper: str | None = None) -> None:
    """Choose one of ENGINES and its settings; what is None stays as it is in the file.

    samples: of every pixel, by our engine or by Cycles. weights: BUNDLED, or a folder. light: one of
    LIGHTS. with_reference: beside Cycles, with `reference_samples`. unclamped: Cycles keeps light that has bounced
    as it is. device, precision: as model/renderer.py takes them, of the network. triangles: at most. tone_mapper: one
    of TONE_MAPPERS, for PNG files.
    """
    scene.render.engine = ENGINES[engine]
    if samples:
        owner, name = (scene.cycles, "samples") if engine == "cycles" else (scene.renderformer_v2, "guide_samples")
        setattr(owner, name, samples)
        scene.renderformer_v2.use_adaptive_sampling = False
    if threads:
        scene.render.threads_mode, scene.render.threads = "FIXED", threads
        scene.renderformer_v2.threads_mode = "AUTO"  # Blender's
    if resolution:
        scene.render.resolution_x, scene.render.resolution_y = resolution
        scene.render.resolution_percentage = 100
    if weights:
        scene.renderformer_v2.weights_source = "BUNDLED" if weights == BUNDLED else "FOLDER"
        scene.renderformer_v2.weights_folder = os.path.abspath(weights)
    if with_reference:
        scene.renderformer_v2.reference.use = True
        if reference_samples:
            scene.renderformer_v2.reference.samples = reference_samples
    if unclamped:
        scene.cycles.sample_clamp_indirect = 0
    if triangles:
        scene.renderformer_v2.token_budget = triangles
    if device:
        kind, _, card = device.partition(":")
        scene.renderformer_v2.device, scene.renderformer_v2.card = kind, int(card) + 1 if card else 0
    if precision:
        scene.renderformer_v2.precision = precision
    if light:
        scene.renderformer_v2.light = light
    if tone_mapper:
        scene.view_settings.view_transform = VIEWS[tone_mapper]


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
