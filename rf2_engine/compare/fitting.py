# SPDX-License-Identifier: GPL-3.0-or-later
"""Zoom and pan the Image Editors so that two pictures side by side fit, and back again for one picture."""
from __future__ import annotations

from typing import NamedTuple

import bpy

from . import halves
from .state import comparison

MARGIN = 0.04      # of half of the free width
LABELS = 64        # pixels above the pictures, at an interface scale of 1


class View(NamedTuple):
    zoom: float  # pixels of the screen per pixel of the image
    x: float     # from the middle of the image to that of the region, in pixels of the image
    y: float


_before: dict[int, View] = {}  # the views of single pictures, by the editor's address


def fit(size: tuple[int, int] | None) -> None:
    """Zoom every Image Editor that shows the comparison to two pictures of a size in pixels, or back to one (None)."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            space = area.spaces.active
            if area.ui_type != "IMAGE_EDITOR" or not comparison.uses(space.image):
                continue
            region = next(region for region in area.regions if region.type == "WINDOW")
            with bpy.context.temp_override(window=window, area=area, region=region):
                now, before = _current_view(bpy.context), _before.pop(area.as_pointer(), None)
                if size:
                    _before[area.as_pointer()] = now
                if target := _view_of_two(bpy.context, *size) if size else before:
                    space.zoom_percentage = 100 * target.zoom
                    # Only panning lasts: after a render Blender goes back to where the view was panned to last.
                    bpy.ops.image.view_pan(offset=(target.x - now.x, target.y - now.y))


def _current_view(context) -> View:
    region, zoom = context.region, context.space_data.zoom_percentage / 100
    x, y = region.view2d.view_to_region(0.5, 0.5, clip=False)
    return View(zoom, (region.width / 2 - x) / zoom, (region.height / 2 - y) / zoom)


def _view_of_two(context, width: int, height: int) -> View | None:
    """The view in which two pictures fit; None where there is no room."""
    unit = context.preferences.system.ui_scale
    left, middle = halves.free_width(context)[0], halves.middle(context)
    zoom = min((middle - left) * (1 - MARGIN) / width, (context.region.height - 2 * LABELS * unit) / height)
    return View(zoom, (context.region.width - left - middle) / 2 / zoom, 0.0) if zoom > 0 else None
