# SPDX-License-Identifier: GPL-3.0-or-later
"""Zoom and pan of the Image Editors, so that two pictures side by side are seen whole; as it was, for one picture."""
from __future__ import annotations

import bpy

from . import comparison, overlay

MARGIN = 0.04      # of the width that is free
LABELS = 64        # pixels above the pictures, at an interface scale of 1


def fit(side_by_side: bool) -> None:
    """In every Image Editor that shows what is compared, which has to be read."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.ui_type == "IMAGE_EDITOR" and comparison.is_compared(area.spaces.active.image):
                region = next(region for region in area.regions if region.type == "WINDOW")
                with bpy.context.temp_override(window=window, area=area, region=region):
                    bpy.ops.image.view_all(fit_view=True)
                    if side_by_side:
                        _fit_two(area, region)


def _fit_two(area: bpy.types.Area, region: bpy.types.Region) -> None:
    height, width, _ = comparison.a.pixels.shape
    unit = bpy.context.preferences.system.ui_scale
    left, right = overlay.free(bpy.context)
    zoom = min((right - left) * (1 - MARGIN) / (width * (2 + overlay.GAP)),
               max(region.height - 2 * LABELS * unit, 1) / height)
    if zoom <= 0:
        return
    area.spaces.active.zoom_percentage = 100 * zoom
    beside = ((left + right) - region.width) / 2  # the middle of what is free, from that of the region
    bpy.ops.image.view_pan(offset=(width * (1 + overlay.GAP) / 2 - beside / zoom, 0))
