# SPDX-License-Identifier: GPL-3.0-or-later
"""A download of the published weights: a process that reports its progress and can be ended at any time."""
from __future__ import annotations

import os
import sys
from pathlib import Path

from ...model.published.bundle_files import TRANSFORMERS
from .published_weights import repositories
from .worker_process import CurrentProcess, WorkerProcess

WORKER = Path(__file__).with_name("hub_worker.py")
ENVIRONMENT = {  # no traffic but the requested files
    "HF_HUB_DISABLE_TELEMETRY": "1", "HF_HUB_DISABLE_UPDATE_CHECK": "1", "HF_HUB_DISABLE_IMPLICIT_TOKEN": "1",
    "HF_HUB_DISABLE_XET": "1", "HF_HUB_DISABLE_PROGRESS_BARS": "1",
}
TIMEOUT = 20  # seconds without data before a request is made again


class Download(WorkerProcess):
    """asking -> ready (sizes are known) -> fetch() -> fetching -> done; or failed, or cancelled: arrived data stay."""

    RUNNING = ("asking", "fetching")

    def __init__(self, target: Path, token: str = "", transformers: tuple[str, ...] = TRANSFORMERS):
        """Ask the Hub for names and sizes. Raises OSError if no process can be started."""
        super().__init__()
        self.target, self.token, self.transformers = target, token, transformers
        self._begin("asking", "ready")

    def fetch(self) -> None:
        """Download what is missing. Only from "ready"."""
        self._begin("fetching", "done")

    @property
    def needs_token(self) -> bool:
        return self.status in (401, 403)

    def _begin(self, state: str, afterwards: str) -> None:
        environment = {"HF_HUB_DOWNLOAD_TIMEOUT": str(TIMEOUT)} | os.environ | ENVIRONMENT
        environment["PYTHONPATH"] = os.pathsep.join(path for path in sys.path if path)
        request = {"fetch": state == "fetching", "target": str(self.target), "token": self.token,
                   "repositories": repositories(self.transformers)}
        self._start(state, afterwards, [sys.executable, "-P", str(WORKER)], request, environment)


current = CurrentProcess(Download)
