# SPDX-License-Identifier: GPL-3.0-or-later
"""Write the reference of an animation's frame into a file of its own, beside the file of the frame.

Files of still images hold one picture. OpenEXR MultiLayer files have the reference as a pass, movies have no room.
"""
from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np

from .. import main_thread
from ..render_size import frame_size, render_region
from .work import count_layers

SUFFIX = "_cycles"


def is_written(scene: bpy.types.Scene) -> bool:
    """Whether the frames of an animation have such a file."""
    return not scene.render.is_movie_format and scene.render.image_settings.file_format != "OPEN_EXR_MULTILAYER"


def path(scene: bpy.types.Scene, layer: str, view: str = "") -> Path:
    """NAME0001_cycles.png for NAME0001.png; with the view layer where there are several, and the suffix of the view."""
    frame, ending = Path(scene.render.frame_path(frame=scene.frame_current)), scene.render.file_extension
    has_ending = scene.render.use_file_extension and frame.name.lower().endswith(ending)
    stem, ending = (frame.name[:-len(ending)], frame.name[-len(ending):]) if has_ending else (frame.name, "")
    layer_suffix = f"_{bpy.path.clean_name(layer)}" if count_layers(scene) > 1 else ""
    view_suffix = scene.render.views[view].file_suffix if view in scene.render.views else ""
    return frame.with_name(f"{stem}{SUFFIX}{layer_suffix}{view_suffix}{ending}")


def write(scene: bpy.types.Scene, layer: str, pixels: np.ndarray, view: str = "") -> None:
    """Save (H, W, 4), row 0 on top, as Blender saves the frame, but for dithering. An old file may have to stay.

    `scene` is the user's. Raises OSError or RuntimeError when it cannot be written, RenderCancelled after Esc.
    """
    target = path(scene, layer, view)
    if target.is_file() and not scene.render.use_overwrite:
        return
    target.parent.mkdir(parents=True, exist_ok=True)
    pixels = _full_frame(scene, pixels)
    main_thread.call(lambda: _save(scene, target, pixels))


def _full_frame(scene: bpy.types.Scene, pixels: np.ndarray) -> np.ndarray:
    """The frame around a render region that is not cropped is empty."""
    width, height = frame_size(scene.render)
    if pixels.shape[:2] == (height, width) or scene.render.use_crop_to_border:
        return pixels
    left, right, bottom, top = render_region(width, height, scene.render)
    full = np.zeros((height, width, 4), np.float32)
    full[height - top:height - bottom, left:right] = pixels
    return full


def _save(scene: bpy.types.Scene, target: Path, pixels: np.ndarray) -> None:
    height, width, _ = pixels.shape
    image = bpy.data.images.new(target.name, width, height, alpha=True, float_buffer=True)
    try:
        image.alpha_mode = "PREMUL"
        image.pixels.foreach_set(np.ascontiguousarray(pixels[::-1], np.float32).ravel())
        image.save_render(str(target), scene=scene)
    finally:
        bpy.data.images.remove(image)
        _settle()


def _settle() -> None:
    """Have Blender build what it evaluates for its windows now, as it does after a data-block has come and gone.

    It would do so while the render goes on and builds the same for its next frame in another thread, which can crash.
    """
    for window in bpy.context.window_manager.windows:
        window.view_layer.update()
