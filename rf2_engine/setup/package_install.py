# SPDX-License-Identifier: GPL-3.0-or-later
"""An installation of packages as a process that reports its progress, and cleans up when it is ended."""
from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

from . import distributions, wheels
from .worker_process import WorkerProcess

WORKER = Path(__file__).with_name("package_worker.py")
PATIENCE = 10  # seconds to tidy up when Blender ends


class Installation(WorkerProcess):
    """installing -> done; or failed; or cancelling -> cancelled. Packages that are complete by then are kept."""

    RUNNING = ("installing", "cancelling")

    def __init__(self, target: Path, wanted: list[wheels.Wheel], *, by_content: bool = False, index: str = "",
                 torch_index: str = ""):
        """Brings what is missing of `wanted`; by_content looks into the files that are there.

        index is the address of the package index (empty: pip's own), torch_index that of a build of PyTorch for
        which no hashes are known here: its index has them. Raises OSError when no process can be started.
        """
        super().__init__()
        self.was_loaded = any(wheel.name in sys.modules for wheel in wanted)  # and stays what it was
        request = {"target": str(target), "by_content": by_content, "wheels": [
            dataclasses.asdict(wheel) | {"index": index if wheel.sha256 else torch_index} for wheel in wanted]}
        self._start("installing", "done", [sys.executable, "-I", str(WORKER)], request)

    def cancel(self) -> None:
        """Ask the process to tidy up and end, and come back at once."""
        if self.is_running:
            self._cancelled, self.state = True, "cancelling"
            self._close_input()

    def end(self) -> None:
        """Cancel, and wait."""
        self.cancel()
        self.wait(PATIENCE)
        if self.is_running:
            super().cancel()


current: Installation | None = None  # the one that the panels show


def is_running() -> bool:
    return current is not None and current.is_running


def begin(*arguments, **options) -> Installation:
    """Installation(...); the result is `current`. Only when none is running."""
    global current
    current = Installation(*arguments, **options)
    return current


def forget() -> None:
    """End what runs and go back to the beginning."""
    global current
    if current:
        current.end()
    current = None


def tidy_up(target: Path | None) -> None:
    """Remove what a process left that could not do it, unless one is at work in there."""
    if target and (target / distributions.STAGING).is_dir():
        Installation(target, [])
