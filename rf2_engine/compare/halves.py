# SPDX-License-Identifier: GPL-3.0-or-later
"""Side by Side: the left half of an Image Editor shows A, the right half the same part of B at the same zoom."""
from __future__ import annotations

from typing import NamedTuple

ICONS = 56  # pixels of Blender's own gizmos at the right edge, at an interface scale of 1


class Halves(NamedTuple):
    """Where both halves of the editor show the image, in widths of the image from its left edge."""

    end_of_a: float  # what is left of it is in the left half of the editor
    begin_b: float   # what is right of it, moved by `shift`, is in the right half
    shift: float


def free_width(context) -> tuple[float, float]:
    """Left and right end of the region without toolbar, sidebar and Blender's gizmos, in its pixels."""
    left, right = 0, context.region.width
    for region in context.area.regions:
        if region.width > 1 and region.type == "TOOLS":
            left = max(left, region.x + region.width - context.region.x)
        elif region.width > 1 and region.type == "UI":
            right = min(right, region.x - context.region.x)
    return left, right - ICONS * context.preferences.system.ui_scale


def middle(context) -> float:
    """Where the halves meet, in pixels of the region."""
    left, right = free_width(context)
    return (left + right) / 2


def find(context) -> Halves:
    """The parts of both pictures that this Image Editor shows."""
    view, (left, right) = context.region.view2d, free_width(context)
    begin, end = (view.view_to_region(x, 0, clip=False)[0] for x in (0, 1))
    return divide(begin, max(end - begin, 1), left, right)


def divide(begin: float, width: float, left: float, right: float) -> Halves:
    """All in pixels of the region: where the image begins, how wide it is, and the ends of what is free."""
    end_of_a, shift = ((left + right) / 2 - begin) / width, (right - left) / 2 / width
    return Halves(min(max(end_of_a, 0), 1), min(max(end_of_a - shift, 0), 1), shift)
