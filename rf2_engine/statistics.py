# SPDX-License-Identifier: GPL-3.0-or-later
"""What the view layers of the last frame were made of, how long they took, and what went wrong."""
from __future__ import annotations

from dataclasses import dataclass, field

import bpy
from bpy.app.handlers import persistent

REFERENCE = "Cycles Reference"  # the stage, and the pass


@dataclass(frozen=True)
class LayerStatistics:
    """One view layer; with an `error` the rest is empty."""

    layer: str
    error: str = ""
    size: tuple[int, int] = (0, 0)  # width, height in pixels, of the render border
    triangles: int = 0
    tokens: int = 0
    weights: str = ""
    seconds: dict[str, float] = field(default_factory=dict)  # by stage
    report: list[str] = field(default_factory=list)  # what was approximated or left out
    reference_samples: int = 0  # of Cycles; 0 when no reference was rendered

    @property
    def reference_seconds(self) -> float:
        return self.seconds.get(REFERENCE, 0.0)

    @property
    def picture_seconds(self) -> float:
        return sum(self.seconds.values()) - self.reference_seconds


def stamp(engine: bpy.types.RenderEngine) -> None:
    """Write into the metadata of the result what the frame has taken so far, all view layers together."""
    done = [layer for layer in last_frame if not layer.error]
    result = engine.get_result()
    result.stamp_data_add_field("RenderFormer-V2 seconds", f"{sum(layer.picture_seconds for layer in done):.2f}")
    if any(layer.reference_samples for layer in done):
        seconds = sum(layer.reference_seconds for layer in done)
        result.stamp_data_add_field(f"{REFERENCE} seconds", f"{seconds:.2f}")
        result.stamp_data_add_field(f"{REFERENCE} samples", str(max(layer.reference_samples for layer in done)))


# The view layers of the last frame that were finished or failed, in the order in which they were rendered.
last_frame: list[LayerStatistics] = []


@persistent
def _clear(*_):
    last_frame.clear()


_EVENTS = ("render_init", "render_pre")  # a render may fail before its first frame


def register() -> None:
    for event in _EVENTS:
        getattr(bpy.app.handlers, event).append(_clear)


def unregister() -> None:
    for event in _EVENTS:
        if _clear in getattr(bpy.app.handlers, event):
            getattr(bpy.app.handlers, event).remove(_clear)
    last_frame.clear()
