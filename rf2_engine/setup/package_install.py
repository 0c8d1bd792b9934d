# SPDX-License-Identifier: GPL-3.0-or-later
"""An installation of packages: a process that reports its progress and cleans up when it is ended."""
from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

from . import distributions
from .wheels import Wheel
from .worker_process import CurrentProcess, WorkerProcess

WORKER = Path(__file__).with_name("package_worker.py")
PATIENCE = 10  # seconds to tidy up when Blender ends


class Installation(WorkerProcess):
    """installing -> done; or failed; or cancelling -> cancelled. Packages that are complete by then are kept."""

    RUNNING = ("installing", "cancelling")

    def __init__(self, target: Path, wheels: list[Wheel], *, by_content: bool = False, index: str = "",
                 torch_index: str = ""):
        """Install those of `wheels` that are missing; by_content: or whose files are damaged.

        index is the address of the package index (empty: pip's own); torch_index that of PyTorch, for a build
        whose hashes only its index knows. Raises OSError if no process can be started.
        """
        super().__init__()
        self.was_loaded = any(wheel.name in sys.modules for wheel in wheels)  # the loaded version stays in use
        request = {"target": str(target), "by_content": by_content, "wheels": [
            dataclasses.asdict(wheel) | {"index": index if wheel.sha256 else torch_index} for wheel in wheels]}
        self._start("installing", "done", [sys.executable, "-I", str(WORKER)], request)

    def cancel(self) -> None:
        """Ask the process to tidy up and end; does not wait for it."""
        if self.is_running:
            self._cancelled, self.state = True, "cancelling"
            self._close_input()

    def end(self) -> None:
        """Cancel, and wait until it has tidied up."""
        self.cancel()
        self.wait(PATIENCE)
        if self.is_running:
            super().cancel()


current = CurrentProcess(Installation)


def tidy_up(target: Path | None) -> None:
    """Remove what a killed process left, unless another one is at work there."""
    if target and (target / distributions.STAGING).is_dir():
        Installation(target, [])
