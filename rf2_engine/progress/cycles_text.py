# SPDX-License-Identifier: GPL-3.0-or-later
"""Progress of Cycles while it runs inside our engine.

No function returns it, but Cycles writes its status into the text that every RenderEngine has. We read it there: its
address is found once, by a text that we set ourselves, and never written to.
"""
from __future__ import annotations

import ctypes
import re

import bpy

SEARCHED = 256  # bytes from the start of the engine in which the text begins; it has 512 itself
_TILES = re.compile(r"Rendered (\d+)/(\d+) Tiles")
_SAMPLES = re.compile(r"Sample (\d+)/(\d+)")
_AFTER_THE_LAST_SAMPLE = ("Reading full buffer", "Denoising", "Finishing", "Finished")


class EngineText:
    """The text that was last set with `engine.update_stats`, by Cycles or us; valid as long as the engine lives."""

    def __init__(self, engine: bpy.types.RenderEngine, current: str) -> None:
        """current: the text that we have set last. A Blender that has it elsewhere gives empty texts."""
        start, pattern = engine.as_pointer(), current.encode()
        at = ctypes.string_at(start, SEARCHED + len(pattern)).find(pattern) if pattern else -1
        self._address = start + at if at >= 0 else None
        self._samples = 0

    def read(self) -> str:
        text = ctypes.string_at(self._address).decode(errors="replace") if self._address else ""
        self._samples = max(self._samples, _samples(text))
        return text

    def samples(self, target: int) -> int:
        """Samples, of `target`, that every pixel had when the text was last read; 0 while tiles are missing."""
        return target if "Finished" in self.read() else self._samples


def _samples(text: str) -> int:
    if (tiles := _TILES.search(text)) and int(tiles[1]) < int(tiles[2]):
        return 0
    match = _SAMPLES.search(text)
    return int(match[1]) if match else 0


def fraction(text: str, elapsed: float = 0.0, time_limit: float = 0.0) -> float:
    """0 to 1 of a render of Cycles, by its status `text`; it began `elapsed` seconds ago. time_limit 0: no limit."""
    if any(words in text for words in _AFTER_THE_LAST_SAMPLE):
        return 1.0
    done = 0.0
    if samples := _SAMPLES.search(text):
        done = int(samples[1]) / max(int(samples[2]), 1)
    if tiles := _TILES.search(text):
        finished, all_tiles = int(tiles[1]), max(int(tiles[2]), 1)
        done = min(finished + done * (done < 1), all_tiles) / all_tiles  # a finished tile is counted already
    return min(max(done, elapsed / time_limit if time_limit else 0.0), 1.0)
