# SPDX-License-Identifier: GPL-3.0-or-later
"""The size of a frame, and the part of it that is rendered."""
from __future__ import annotations

import bpy
import numpy as np

Border = tuple[int, int, int, int]


def border(width: int, height: int, settings: bpy.types.RenderSettings) -> Border | None:
    """The `region` of the picture that is rendered; None without a render border."""
    return region(width, height, settings) if settings.use_border else None


def size(settings: bpy.types.RenderSettings) -> tuple[int, int]:
    """Width and height of the frame, as Blender rounds them."""
    return tuple(pixels * settings.resolution_percentage // 100 for pixels in (settings.resolution_x,
                                                                               settings.resolution_y))


def region(width: int, height: int, settings: bpy.types.RenderSettings) -> Border:
    """Pixels (x0, x1, y0, y1) of the render region, from the bottom left, rounded as Blender does."""
    pixels = np.float32([width, width, height, height])
    corners = np.float32([settings.border_min_x, settings.border_max_x, settings.border_min_y, settings.border_max_y])
    return tuple((corners * pixels).astype(int).tolist())
