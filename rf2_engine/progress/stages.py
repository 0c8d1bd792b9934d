# SPDX-License-Identifier: GPL-3.0-or-later
"""The stages of a frame: their texts, and the units of their cost."""
from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple


@dataclass(frozen=True)
class Stage:
    """A named part of a frame's work. Several may have one text; the user then sees them as one."""

    text: str            # in the status while it runs, and in Last Render with its seconds
    unit: str            # what its work is counted in
    first_guess: float   # seconds for a unit on two processor cores, until this machine has measured it
    part: str = ""       # which of those with the same text it is

    @property
    def key(self) -> str:
        """Its name in the file of costs (costs.py)."""
        return f"{self.text}, {self.part}" if self.part else self.text


class Work(NamedTuple):
    """What a stage has to do in a view layer: it is entered `times` times, each for `units` units."""

    units: float
    times: int = 1

    @property
    def total(self) -> float:
        return self.units * self.times


# In the order of a frame.
CONVERT = Stage("Converting the scene", "scene", 1.0)
LOAD = Stage("Loading the network", "network", 3.0)
ALPHA = Stage("Camera rays", "sample of a pixel", 2.5e-6, "alpha")
CATCHERS = Stage("Camera rays", "sample of a pixel", 2.5e-6, "shadow catchers")
FIRST_HITS = Stage("Camera rays", "sample of a pixel", 2.5e-6)
SAMPLE_HITS = Stage("Camera rays", "sample of a pixel", 2.5e-6, "blur")  # for a sample on the lens or in the shutter
TEXTURES = Stage("Encoding textures", "triangle", 1e-3)  # for published weights
ENCODE = Stage("Network", "triangle", 3e-4, "scene")
VIEW = Stage("Network", "pixel", 2e-5, "view")
GROUPS = Stage("Light groups", "pixel of a group", 1e-5)
EDGES = Stage("Network", "pixel", 2e-6, "edges")
DIVIDE = Stage("Dividing the light", "pixel", 2e-7)
WRITE = Stage("Writing passes", "pixel", 2e-7)
REFERENCE = Stage("Cycles Reference", "sample of a pixel", 4e-6)
