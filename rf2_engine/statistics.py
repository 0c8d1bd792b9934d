# SPDX-License-Identifier: GPL-3.0-or-later
"""What the view layers of the last frame were made of, how long they took, and what went wrong."""
from __future__ import annotations

from dataclasses import dataclass, field

import bpy
from bpy.app.handlers import persistent

from . import estimate
from .convert.report import Remark
from .setup import redraw


@dataclass(frozen=True)
class LayerStatistics:
    """One view layer; with an `error`, or when it was cancelled, the rest is empty."""

    layer: str
    error: str = ""
    cancelled: bool = False
    size: tuple[int, int] = (0, 0)  # width, height in pixels, of the render border
    triangles: int = 0
    tokens: int = 0
    weights: str = ""
    seconds: dict[str, float] = field(default_factory=dict)  # by stage
    remarks: list[Remark] = field(default_factory=list)  # what was approximated or left out

    @property
    def report(self) -> list[str]:
        """The remarks, a sentence each."""
        return [str(remark) for remark in self.remarks]


# The view layers of the last frame, in the order in which they were rendered.
last_frame: list[LayerStatistics] = []


@persistent
def _clear(*_):
    last_frame.clear()
    estimate.begin_frame()


@persistent
def _show(*_):
    if not bpy.app.background:
        redraw.keep_redrawing()


_HANDLERS = (("render_init", _clear), ("render_pre", _clear),  # a render may fail before its first frame
             ("render_complete", _show), ("render_cancel", _show))


def register() -> None:
    for event, handler in _HANDLERS:
        getattr(bpy.app.handlers, event).append(handler)


def unregister() -> None:
    for event, handler in _HANDLERS:
        if handler in getattr(bpy.app.handlers, event):
            getattr(bpy.app.handlers, event).remove(handler)
    last_frame.clear()
