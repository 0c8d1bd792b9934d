# SPDX-License-Identifier: GPL-3.0-or-later
"""Find how far Cycles is while it runs inside our engine.

There is no function for it. But Cycles writes its status into the text that every RenderEngine has, so it is read
there. Its address is found once, by a text that we set ourselves. It is never written to.
"""
from __future__ import annotations

import ctypes
import re

import bpy

FARTHEST = 256  # bytes from the start of the engine; the text alone has 512
_TILES = re.compile(r"Rendered (\d+)/(\d+) Tiles")
_SAMPLES = re.compile(r"Sample (\d+)/(\d+)")
_AFTER_THE_LAST_SAMPLE = ("Reading full buffer", "Denoising", "Finishing", "Finished")


class EngineText:
    """What was last shown with `engine.update_stats`, by whomever; for as long as the engine lives."""

    def __init__(self, engine: bpy.types.RenderEngine, shown: str) -> None:
        """`shown`: what we showed last; a Blender that keeps it elsewhere gives no text at all."""
        start, wanted = engine.as_pointer(), shown.encode()
        at = ctypes.string_at(start, FARTHEST + len(wanted)).find(wanted) if wanted else -1
        self._address = start + at if at >= 0 else None
        self._samples = 0

    def read(self) -> str:
        text = ctypes.string_at(self._address).decode(errors="replace") if self._address else ""
        self._samples = max(self._samples, _samples(text))
        return text

    def samples(self, wanted: int) -> int:
        """Of the `wanted` samples those that every pixel had by the last time anybody read; 0 while tiles miss."""
        return wanted if "Finished" in self.read() else self._samples


def _samples(text: str) -> int:
    if (tiles := _TILES.search(text)) and int(tiles[1]) < int(tiles[2]):
        return 0
    found = _SAMPLES.search(text)
    return int(found[1]) if found else 0


def fraction(text: str, elapsed: float = 0.0, time_limit: float = 0.0) -> float:
    """0 to 1 of a render of Cycles whose status is `text`; `elapsed` seconds ago it began, 0 is no limit."""
    if any(words in text for words in _AFTER_THE_LAST_SAMPLE):
        return 1.0
    done = 0.0
    if samples := _SAMPLES.search(text):
        done = int(samples[1]) / max(int(samples[2]), 1)
    if tiles := _TILES.search(text):
        finished, all_tiles = int(tiles[1]), max(int(tiles[2]), 1)
        done = min(finished + done * (done < 1), all_tiles) / all_tiles  # a full tile was counted already
    return min(max(done, elapsed / time_limit if time_limit else 0.0), 1.0)
