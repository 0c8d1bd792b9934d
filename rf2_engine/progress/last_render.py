# SPDX-License-Identifier: GPL-3.0-or-later
"""Statistics of the view layers of the last frame: size, seconds, report and errors."""
from __future__ import annotations

from dataclasses import dataclass, field

import bpy
from bpy.app.handlers import persistent

from ..convert.data.report import Remark
from ..registering import handlers
from ..runtime.running import ENGINE
from ..setup import redraw
from . import estimate, stages

REFERENCE = stages.REFERENCE.text  # the pass has its name too


@dataclass(frozen=True, eq=False)  # each is its own: panels remember what they have looked up for it
class LayerStatistics:
    """One view layer; with an `error`, or when it was cancelled, the rest is empty."""

    layer: str
    error: str = ""
    cancelled: bool = False
    size: tuple[int, int] = (0, 0)  # width, height in pixels, of the render border
    triangles: int = 0
    tokens: int = 0  # that the network was given
    weights: str = ""
    device: str = ""  # that the network worked on, and in which number format; "" where it had nothing to do
    seconds: dict[str, float] = field(default_factory=dict)  # by stage
    remarks: list[Remark] = field(default_factory=list)  # what was approximated or left out
    reference_samples: int = 0  # of Cycles; 0 when no reference was rendered

    @property
    def reference_seconds(self) -> float:
        return self.seconds.get(REFERENCE, 0.0)

    @property
    def picture_seconds(self) -> float:
        return sum(self.seconds.values()) - self.reference_seconds

    @property
    def report(self) -> list[str]:
        """The remarks, a sentence each."""
        return [str(remark) for remark in self.remarks]

    @property
    def lines(self) -> list[str]:
        """All of it as text."""
        if self.error or self.cancelled:
            return [f"{self.layer}: {self.error or 'cancelled'}"]
        width, height = self.size
        return [f"{self.layer}: {width} x {height} pixels, {self.triangles} triangles, weights {self.weights}"
                f"{f', {self.device}' * bool(self.device)}",
                *(f"{stage}: {seconds:.2f} s" for stage, seconds in self.seconds.items()), *self.report]


def as_text() -> str:
    """The last frame, all view layers."""
    return "\n".join(line for layer in last_frame for line in layer.lines)


def stamp(engine: bpy.types.RenderEngine) -> None:
    """Write into the metadata of the result what the frame has taken so far and what it lacks, all view layers.

    A picture that is saved keeps it; .blend files hold no pictures.
    """
    done = [layer for layer in last_frame if not (layer.error or layer.cancelled)]
    result = engine.get_result()
    for layer in done:  # for Compare, by pass
        result.stamp_data_add_field(f"{layer.layer}.Combined.seconds", f"{layer.picture_seconds:.2f}")
        if layer.reference_samples:
            result.stamp_data_add_field(f"{layer.layer}.{REFERENCE}.seconds", f"{layer.reference_seconds:.2f}")
            result.stamp_data_add_field(f"{layer.layer}.{REFERENCE}.samples", str(layer.reference_samples))
    result.stamp_data_add_field("RenderFormer-V2 seconds", f"{sum(layer.picture_seconds for layer in done):.2f}")
    if devices := ", ".join(dict.fromkeys(layer.device for layer in done if layer.device)):
        result.stamp_data_add_field("RenderFormer-V2 device", devices)
    if report := "\n".join(dict.fromkeys(line for layer in done for line in layer.report)):
        result.stamp_data_add_field("RenderFormer-V2 report", report)
    if any(layer.reference_samples for layer in done):
        seconds = sum(layer.reference_seconds for layer in done)
        result.stamp_data_add_field(f"{REFERENCE} seconds", f"{seconds:.2f}")
        result.stamp_data_add_field(f"{REFERENCE} samples", str(max(layer.reference_samples for layer in done)))


# The view layers of the last frame of ours, in the order in which they were rendered.
last_frame: list[LayerStatistics] = []
_is_over = True  # what is added belongs to another frame


def add(layer: LayerStatistics) -> None:
    """One view layer of the frame that is being rendered is done."""
    global _is_over
    if _is_over:
        last_frame.clear()
    _is_over = False
    last_frame.append(layer)


@persistent
def _begin(scene: bpy.types.Scene, *_):
    """Of a frame of any engine; those of others leave ours, which another slot may still show."""
    global _is_over
    _is_over = True
    estimate.begin_frame()
    if scene.render.engine == ENGINE:
        last_frame.clear()


@persistent
def _clear(*_):
    last_frame.clear()


@persistent
def _show(*_):
    if not bpy.app.background:
        redraw.keep_redrawing()


register, _remove_handlers = handlers(
    ("render_init", _begin), ("render_pre", _begin),  # a render may fail before its first frame
    ("load_post", _clear),                            # the picture is gone, too
    ("render_complete", _show), ("render_cancel", _show))


def unregister() -> None:
    _remove_handlers()
    last_frame.clear()
