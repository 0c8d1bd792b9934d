# SPDX-License-Identifier: GPL-3.0-or-later
"""Zoom and pan of the Image Editors, so that two pictures side by side are seen whole; as it was, for one picture."""
from __future__ import annotations

from typing import NamedTuple

import bpy

from . import comparison, overlay

MARGIN = 0.04      # of the width that is free
LABELS = 64        # pixels above the pictures, at an interface scale of 1


class View(NamedTuple):
    zoom: float  # pixels of the screen for one of the image
    x: float     # of the region's middle from the image's, in pixels of the image
    y: float


_before: dict[int, View] = {}  # by the editor's address


def fit(size: tuple[int, int] | None) -> None:
    """In every Image Editor that shows what is compared, to two pictures of that size in pixels, or back to one."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            space = area.spaces.active
            if area.ui_type != "IMAGE_EDITOR" or not comparison.is_compared(space.image):
                continue
            region = next(region for region in area.regions if region.type == "WINDOW")
            with bpy.context.temp_override(window=window, area=area, region=region):
                now, before = _now(bpy.context), _before.pop(area.as_pointer(), None)
                if size:
                    _before[area.as_pointer()] = now
                if wanted := _of_two(bpy.context, *size) if size else before:
                    space.zoom_percentage = 100 * wanted.zoom
                    # After a render Blender goes back to where something was panned to last: nothing else moves it.
                    bpy.ops.image.view_pan(offset=(wanted.x - now.x, wanted.y - now.y))


def _now(context) -> View:
    region, zoom = context.region, context.space_data.zoom_percentage / 100
    x, y = region.view2d.view_to_region(0.5, 0.5, clip=False)
    return View(zoom, (region.width / 2 - x) / zoom, (region.height / 2 - y) / zoom)


def _of_two(context, width: int, height: int) -> View | None:
    """None where there is no room."""
    unit = context.preferences.system.ui_scale
    left, right = overlay.free(context)
    zoom = min((right - left) * (1 - MARGIN) / (width * (2 + overlay.GAP)),
               (context.region.height - 2 * LABELS * unit) / height)
    beside = (left + right - context.region.width) / 2  # the middle of what is free, from that of the region
    return View(zoom, width * (1 + overlay.GAP) / 2 - beside / zoom, 0.0) if zoom > 0 else None
