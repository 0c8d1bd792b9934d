# SPDX-License-Identifier: GPL-3.0-or-later
"""The size of a frame in pixels, and the part of it that is rendered."""
from __future__ import annotations

import bpy
import numpy as np

Border = tuple[int, int, int, int]


def frame_size(settings: bpy.types.RenderSettings) -> tuple[int, int]:
    """Width and height of the frame, rounded as Blender does: it renders at least one pixel."""
    return tuple(max(pixels * settings.resolution_percentage // 100, 1)
                 for pixels in (settings.resolution_x, settings.resolution_y))


def render_border(width: int, height: int, settings: bpy.types.RenderSettings) -> Border | None:
    """The `render_region` if a render border is set, else None."""
    return render_region(width, height, settings) if settings.use_border else None


def render_region(width: int, height: int, settings: bpy.types.RenderSettings) -> Border:
    """Pixels (x0, x1, y0, y1) of the render region, from the bottom left, rounded as Blender does."""
    pixels = np.float32([width, width, height, height])
    corners = np.float32([settings.border_min_x, settings.border_max_x, settings.border_min_y, settings.border_max_y])
    return tuple((corners * pixels).astype(int).tolist())
