# SPDX-License-Identifier: GPL-3.0-or-later
"""Who made a pass, with how many samples and in how many seconds: what the engines note in the render or in a file."""
from __future__ import annotations

from typing import NamedTuple

from .. import passes as pass_table
from ..frame.reference import NAME as REFERENCE

OURS = "RenderFormer-V2"
OUR_SECONDS = f"{OURS} seconds"


class Credits(NamedTuple):
    engine: str = ""            # empty: not known
    samples: int | None = None  # of Cycles
    seconds: float | None = None

    def __str__(self) -> str:
        """"Cycles, 256 samples, 78 s"."""
        said = [self.engine, "" if self.samples is None else f"{self.samples} sample{'s' * (self.samples != 1)}",
                "" if self.seconds is None else f"{self.seconds:.{0 if self.seconds > 9.95 else 1}f} s"]
        return ", ".join(filter(None, said))


def of_pass(metadata: dict[str, str], layer: str, name: str) -> Credits:
    beside = name in pass_table.REFERENCE_NAMES  # Cycles beside another engine
    by_us = OUR_SECONDS in metadata
    samples = metadata.get(f"{layer}.{REFERENCE}.samples") if beside else None
    if by_us or beside:
        engine = "Cycles" if beside else OURS
    else:
        samples = samples or metadata.get(f"cycles.{layer}.samples")
        engine = "Cycles" if any(key.startswith("cycles.") for key in metadata) else ""
    return Credits(engine, int(samples) if samples and samples.isdecimal() else None, seconds(metadata, layer, name))


def seconds(metadata: dict[str, str], layer: str, name: str) -> float | None:
    """How long a pass took; None if nobody noted it.

    `LAYER.PASS.seconds` counts first; a pass of Cycles beside another engine's has Cycles' own time; else it is the
    whole render's, our own without Cycles.
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
    """Whether no reference of the layer was noted; its pass is there, and black, when it was stopped or failed."""
    return f"{layer}.{REFERENCE}.seconds" not in metadata
