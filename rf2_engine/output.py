# SPDX-License-Identifier: GPL-3.0-or-later
"""From the network's radiance to Blender's render result."""
from __future__ import annotations

from contextlib import contextmanager

import bpy
import numpy as np

from ..model.scene import Guides
from . import passes as pass_table

ERROR_CHECKER = 16  # pixels
ERROR_COLORS = np.array([[0.6, 0.0, 0.4, 1.0], [0.05, 0.0, 0.04, 1.0]], np.float32)


def composite(radiance: np.ndarray, guides: Guides, film_transparent: bool, exposure: float) -> np.ndarray:
    """(H, W, 4) f32 Combined, premultiplied: surfaces and volumes + emitters seen directly + the world behind them."""
    color = radiance + guides.emission
    alpha = guides.alpha
    if not film_transparent:
        color, alpha = color + guides.environment, np.ones_like(alpha)
    return np.dstack([color * exposure, alpha]).astype(np.float32)


def write(engine: bpy.types.RenderEngine, layer: str, passes: dict[str, np.ndarray]) -> None:
    """Hand {key of passes.PASSES: (H, W, C), row 0 on top} of one view layer to Blender."""
    names = {p.blender_name: p.key for p in pass_table.PASSES}
    result = engine.begin_result(0, 0, engine.resolution_x, engine.resolution_y, layer=layer)
    for p in result.layers[0].passes:
        if names.get(p.name) in passes:
            p.rect.foreach_set(np.ascontiguousarray(passes[names[p.name]][::-1], np.float32).ravel())
    engine.end_result(result)


@contextmanager
def stand_in(engine: bpy.types.RenderEngine, layer: str, passes: dict[str, np.ndarray], combined: np.ndarray):
    """Show `combined` (H, W, 4) while the picture is made inside; it is taken back when that ends without one.

    The other passes stay: they are what they will be.
    """
    write(engine, layer, passes | {"combined": combined})
    try:
        yield
    except BaseException:
        write(engine, layer, passes | {"combined": np.zeros_like(combined)})
        raise


def write_error(engine: bpy.types.RenderEngine, layer: str) -> None:
    """A magenta checkerboard: nobody takes it for a picture, and nobody waits for one in a black frame."""
    result = engine.begin_result(0, 0, engine.resolution_x, engine.resolution_y, layer=layer)
    y, x = np.indices((result.resolution_y, result.resolution_x)) // ERROR_CHECKER
    for p in result.layers[0].passes:
        if p.name == "Combined":
            p.rect.foreach_set(ERROR_COLORS[(x + y) % 2].ravel())
    engine.end_result(result)
