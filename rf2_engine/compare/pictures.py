# SPDX-License-Identifier: GPL-3.0-or-later
"""A picture to compare: its pixels, who rendered it with how many samples in how many seconds, and its label."""
from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .. import passes as pass_table
from ..progress.last_render import REFERENCE
from .slots import Crop

OURS = "RenderFormer-V2"
OUR_SECONDS = f"{OURS} seconds"
USUAL = ("Combined", *pass_table.REFERENCE_NAMES)  # passes that the engine's name says enough about


class Credits(NamedTuple):
    """Who rendered a pass, as the engines note it in a render result or a file."""

    engine: str = ""            # empty: unknown
    samples: int | None = None  # of Cycles
    seconds: float | None = None

    def __str__(self) -> str:
        """"Cycles, 256 samples, 78 s"."""
        parts = [self.engine, "" if self.samples is None else f"{self.samples} sample{'s' * (self.samples != 1)}",
                 "" if self.seconds is None else f"{self.seconds:.{0 if self.seconds > 9.95 else 1}f} s"]
        return ", ".join(filter(None, parts))


@dataclass(frozen=True)
class Picture:
    path: tuple[str, ...]  # slot or image; for a pass also its view layer and its name; in stereoscopy its view
    pixels: np.ndarray     # (H, W, 4) f32, scene-linear, premultiplied, row 0 on top
    crop: Crop             # the part of the frame that it shows
    rendered: Crop         # the part of it that was rendered, in its own pixels
    credits: Credits = Credits()

    @property
    def name(self) -> str:
        return ", ".join(self.path)

    @property
    def label(self) -> str:
        """"Cycles, 256 samples, 78 s (Slot 1, ViewLayer, Combined)"."""
        credits = str(self.credits)
        return f"{credits} ({self.name})" if credits else self.name


def read_credits(metadata: dict[str, str], layer: str, name: str) -> Credits:
    """The credits of a pass from the metadata of its file."""
    is_reference = name in pass_table.REFERENCE_NAMES  # Cycles beside another engine
    is_ours = OUR_SECONDS in metadata
    samples = metadata.get(f"{layer}.{REFERENCE}.samples") if is_reference else None
    if is_ours or is_reference:
        engine = "Cycles" if is_reference else OURS
    else:
        samples = samples or metadata.get(f"cycles.{layer}.samples")
        engine = "Cycles" if any(key.startswith("cycles.") for key in metadata) else ""
    return Credits(engine, int(samples) if samples and samples.isdecimal() else None,
                   read_seconds(metadata, layer, name))


def read_seconds(metadata: dict[str, str], layer: str, name: str) -> float | None:
    """The seconds that a pass took; None if nothing notes them.

    `LAYER.PASS.seconds` comes first. Without it a pass of Cycles beside another engine's has the time of Cycles, and
    any other pass that of the whole render; of a render of ours, without Cycles.
    """
    keys = [f"{layer}.{name}.seconds", OUR_SECONDS, "RenderTime"]
    if name.startswith("Cycles "):
        keys = [keys[0], f"{layer}.{REFERENCE}.seconds", f"cycles.{layer}.total_time"]
    for text in (metadata[k] for k in keys if k in metadata):
        try:
            return sum(float(part) * 60 ** i for i, part in enumerate(reversed(text.split(":"))))
        except ValueError:
            continue
    return None


def lacks_reference(metadata: dict[str, str], layer: str) -> bool:
    """Whether the layer has no reference: its pass exists and is black when the reference was stopped or failed."""
    return f"{layer}.{REFERENCE}.seconds" not in metadata


def label_pair(a: Picture, b: Picture, has_layers: bool) -> list[tuple[str, str]]:
    """Pairs of labels, the longest first. has_layers: whether there are several view layers to tell apart."""
    return [(a.label, b.label), (_short_label(a, b, has_layers), _short_label(b, a, has_layers))]


def _short_label(picture: Picture, other: Picture, has_layers: bool) -> str:
    """Only what the two do not have in common and the header of the Image Editor does not say."""
    if not picture.credits.engine or picture.credits == other.credits:
        return picture.name
    slot, layer, pass_name, view = (*picture.path, "", "", "")[:4]
    other_slot, other_layer, *_ = (*other.path, "")
    parts = [slot if slot != other_slot else "", layer if has_layers or layer != other_layer else "",
             pass_name if pass_name not in USUAL else "", view]
    details = ", ".join(filter(None, parts))
    return f"{picture.credits} ({details})" if details else str(picture.credits)


def longest_pair(labels: Iterable[tuple[str, str]], fits: Callable[[str, str], bool]) -> tuple[str, str]:
    """The first pair that `fits`, or else the last."""
    for pair in labels:
        if fits(*pair):
            break
    return pair
