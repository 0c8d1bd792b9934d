# SPDX-License-Identifier: GPL-3.0-or-later
"""The log of a run: one JSON object a line. A resumed run appends to it; only the first process writes."""
from __future__ import annotations

import json
import time
from pathlib import Path

from . import ranks


class Log:
    def __init__(self, path: Path):
        self.path, self.begin = path, time.monotonic()
        self.sums: dict[str, float] = {}
        self.count = 0
        if ranks.is_first() and path.is_file() and not path.read_bytes().endswith(b"\n"):  # killed within a line
            self._append("\n")

    def add(self, losses: dict[str, float]) -> None:
        """Count the losses of one step into the means of the next line."""
        for name, value in losses.items():
            self.sums[name] = self.sums.get(name, 0.0) + value
        self.count += 1

    def write(self, step: int, **more) -> None:
        """A line with the means since the last one, also printed."""
        record = {"step": step, "minutes": round((time.monotonic() - self.begin) / 60, 2)}
        record |= {name: round(total / self.count, 7) for name, total in self.sums.items()} | more
        if ranks.is_first():
            self._append(json.dumps(record) + "\n")
            print(record, flush=True)
        self.sums, self.count = {}, 0

    def _append(self, text: str) -> None:
        with open(self.path, "a") as file:
            file.write(text)
