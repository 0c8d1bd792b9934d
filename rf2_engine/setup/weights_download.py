# SPDX-License-Identifier: GPL-3.0-or-later
"""A download of the published weights as Blender sees it: a process that reports, and can be ended at any time."""
from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

from .published_weights import REPOSITORIES

WORKER = Path(__file__).with_name("hub_worker.py")
ENVIRONMENT = {  # nothing but what was asked for goes over the network
    "HF_HUB_DISABLE_TELEMETRY": "1", "HF_HUB_DISABLE_UPDATE_CHECK": "1", "HF_HUB_DISABLE_IMPLICIT_TOKEN": "1",
    "HF_HUB_DISABLE_XET": "1", "HF_HUB_DISABLE_PROGRESS_BARS": "1",
}
TIMEOUT = 20  # seconds without data before a request is made again
RUNNING = ("asking", "fetching")


class Download:
    """asking -> ready (sizes are known) -> fetch() -> fetching -> done; or failed, or cancelled.

    state, total, present (bytes), text, error, needs_token are written by a thread that reads the process's messages.
    """

    def __init__(self, target: Path, token: str = ""):
        """Asks the Hub for names and sizes only; raises OSError when no process can be started."""
        self.target, self.token = target, token
        self.total = self.present = 0
        self.text = self.error = ""
        self.needs_token = False
        self._start("asking")

    def fetch(self) -> None:
        """Download what is missing. Only from "ready"."""
        self._start("fetching")

    def cancel(self) -> None:
        """End the process; what has arrived stays, for the next time."""
        if self.state in RUNNING:
            self._cancelled = True
            self._process.kill()
            self._reader.join()
        self.state = "cancelled"

    def wait(self) -> None:
        """Until "ready" or the end; for scripts, which have no window that could freeze."""
        self._reader.join()

    @property
    def silent_seconds(self) -> float:
        """Since the last message."""
        return time.monotonic() - self._heard

    def _start(self, state: str) -> None:
        self._cancelled, self._heard = False, time.monotonic()
        environment = {"HF_HUB_DOWNLOAD_TIMEOUT": str(TIMEOUT)} | os.environ | ENVIRONMENT
        environment["PYTHONPATH"] = os.pathsep.join(path for path in sys.path if path)
        self._process = subprocess.Popen(
            [sys.executable, "-P", str(WORKER)], env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            encoding="utf-8", creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0))
        self.state = state
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        try:  # the token goes through a pipe: command lines and environments can be seen by others
            with self._process.stdin as stdin:
                json.dump({"fetch": self.state == "fetching", "target": str(self.target), "token": self.token,
                           "repositories": REPOSITORIES}, stdin)
        except OSError:
            pass  # it ended before it listened, which its exit code tells
        for line in self._process.stdout:
            message = json.loads(line)
            self._heard = time.monotonic()
            self.error = message.get("error", "")
            self.needs_token = message.get("status") in (401, 403)
            if not self.error:
                self.total, self.present, self.text = (message[key] for key in ("total", "present", "text"))
        self._process.stdout.close()
        code = self._process.wait()
        if self._cancelled:
            self.state = "cancelled"
        elif code:
            self.error = self.error or f"The download program ended with code {code}: see the console"
            self.state = "failed"
        else:
            self.state = "ready" if self.state == "asking" else "done"


current: Download | None = None  # the one that the preferences show


def is_running() -> bool:
    return current is not None and current.state in RUNNING


def forget() -> None:
    """End what runs and go back to the beginning."""
    global current
    if current:
        current.cancel()
    current = None


def begin(target: Path, token: str) -> Download:
    """Ask for the sizes; the result is `current`."""
    global current
    forget()
    current = Download(target, token)
    return current
