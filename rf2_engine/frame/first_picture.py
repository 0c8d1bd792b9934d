# SPDX-License-Identifier: GPL-3.0-or-later
"""What the Image Editor shows while a scene is converted: surfaces in their own colours, without light."""
from __future__ import annotations

import math

import bpy
import numpy as np

from ...model import progress
from ...model.camera import view_rays_at
from ...model.scene import View
from .. import passes as pass_table
from ..convert.copying.cache import CopyCache
from ..convert.copying.scene import copy
from ..convert.data.report import Report
from ..convert.sketch import PIXELS, Sketch
from .layer import Layer


def show(layer: Layer, views: dict[str, View], passes: dict[str, dict[str, np.ndarray]]) -> CopyCache | None:
    """Write unlit pictures of these views where somebody waits, and return what was read of the scene; else None.

    They are added to `passes` of output.unless_stopped.
    """
    if not is_watched(layer.engine):
        return None
    cache = CopyCache()
    with progress.part(0.0, 0.6):
        sketch = Sketch(copy(layer.depsgraph, Report(), cache=cache.of_meshes(), reads_images=False))
    with progress.part(0.6, 1.0):
        for name, view in views.items():
            passes[name]["combined"] = _picture(sketch, view, layer.settings.film_transparent)
            pass_table.write(layer.engine, layer.name, passes[name], name)
    return cache


def is_watched(engine: bpy.types.RenderEngine) -> bool:
    """Whether it is a single frame in a window."""
    return not (bpy.app.background or engine.is_animation)


def _picture(sketch: Sketch, view: View, transparent: bool) -> np.ndarray:
    """(H, W, 4) in squares of one colour, at most PIXELS."""
    step = max(math.ceil(math.sqrt(view.width * view.height / PIXELS)), 1)
    x, y = (np.arange(0, length, step) + step / 2 for length in (view.width, view.height))
    coarse = sketch.picture(*view_rays_at(view, x, y[:, None]), transparent)
    return coarse.repeat(step, 0).repeat(step, 1)[:view.height, :view.width]
