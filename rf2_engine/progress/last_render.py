# SPDX-License-Identifier: GPL-3.0-or-later
"""Last Render: statistics of the view layers of the last frame: size, seconds, report and errors."""
from __future__ import annotations

from dataclasses import dataclass, field

import bpy
from bpy.app.handlers import persistent

from ..convert.data.report import Remark, grouped
from ..registering import handlers
from ..runtime.running import ENGINE
from ..setup import display
from . import estimate, stages

REFERENCE = stages.REFERENCE.text  # also the name of the pass


@dataclass(frozen=True, eq=False)  # compared by identity: panels cache what they look up for it
class LayerStatistics:
    """One view layer; with an `error`, or when it was cancelled, the rest is empty."""

    layer: str
    error: str = ""
    cancelled: bool = False
    size: tuple[int, int] = (0, 0)  # width and height in pixels, of the render region
    triangles: int = 0
    tokens: int = 0  # of the network's input
    weights: str = ""
    device: str = ""  # of the network, and its number format; "" where it had nothing to do
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
        """The remarks as sentences, one for all that say the same."""
        return [str(group) for group in grouped(self.remarks)]

    @property
    def lines(self) -> list[str]:
        """All statistics as text."""
        if self.error or self.cancelled:
            return [f"{self.layer}: {self.error or 'cancelled'}"]
        width, height = self.size
        return [f"{self.layer}: {width} x {height} pixels, {self.triangles} triangles, weights {self.weights}"
                f"{f', {self.device}' * bool(self.device)}",
                *(f"{stage}: {seconds:.2f} s" for stage, seconds in self.seconds.items()), *self.report]


class LastFrame(list[LayerStatistics]):
    """The view layers of the last frame of ours, in the order of rendering. There is one: `last_frame`."""

    is_over = True  # the next layer belongs to another frame

    def begin(self, is_ours: bool) -> None:
        """A frame of any engine begins; those of others leave ours, which another slot may still show."""
        self.is_over = True
        if is_ours:
            self.clear()

    def add(self, layer: LayerStatistics) -> None:
        """Add a finished view layer of the frame that is being rendered."""
        if self.is_over:
            self.clear()
        self.is_over = False
        self.append(layer)


last_frame = LastFrame()


def as_text() -> str:
    """The last frame with all its view layers."""
    return "\n".join(line for layer in last_frame for line in layer.lines)


def stamp(engine: bpy.types.RenderEngine) -> None:
    """Write seconds and report of all view layers so far into the metadata of the result.

    Saved pictures keep them; .blend files hold no pictures.
    """
    layers = [layer for layer in last_frame if not (layer.error or layer.cancelled)]
    result = engine.get_result()
    for layer in layers:  # for Compare, by pass
        result.stamp_data_add_field(f"{layer.layer}.Combined.seconds", f"{layer.picture_seconds:.2f}")
        if layer.reference_samples:
            result.stamp_data_add_field(f"{layer.layer}.{REFERENCE}.seconds", f"{layer.reference_seconds:.2f}")
            result.stamp_data_add_field(f"{layer.layer}.{REFERENCE}.samples", str(layer.reference_samples))
    result.stamp_data_add_field("RenderFormer-V2 seconds", f"{sum(layer.picture_seconds for layer in layers):.2f}")
    if devices := ", ".join(dict.fromkeys(layer.device for layer in layers if layer.device)):
        result.stamp_data_add_field("RenderFormer-V2 device", devices)
    if report := "\n".join(dict.fromkeys(line for layer in layers for line in layer.report)):
        result.stamp_data_add_field("RenderFormer-V2 report", report)
    if any(layer.reference_samples for layer in layers):
        seconds = sum(layer.reference_seconds for layer in layers)
        result.stamp_data_add_field(f"{REFERENCE} seconds", f"{seconds:.2f}")
        result.stamp_data_add_field(f"{REFERENCE} samples", str(max(layer.reference_samples for layer in layers)))


@persistent
def _begin(scene: bpy.types.Scene, *_):
    estimate.frame.restart()
    last_frame.begin(is_ours=scene.render.engine == ENGINE)


@persistent
def _clear(*_):
    last_frame.clear()


@persistent
def _show(*_):
    if not bpy.app.background:
        display.keep_redrawing()


register, _remove_handlers = handlers(
    ("render_init", _begin), ("render_pre", _begin),  # a render may fail before its first frame
    ("load_post", _clear),                            # another file has no picture
    ("render_complete", _show), ("render_cancel", _show))


def unregister() -> None:
    _remove_handlers()
    last_frame.clear()
