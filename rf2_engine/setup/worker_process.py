# SPDX-License-Identifier: GPL-3.0-or-later
"""Programs of ours that run beside Blender: they get a task, report progress, and can be ended."""
from __future__ import annotations

import json
import subprocess
import threading
import time


class WorkerProcess:
    """A program whose messages a thread reads into state, total, present (bytes), text, error, status and steps.

    It reads one line of JSON from its standard input, which stays open until it has to stop, and writes lines of
    JSON: {"total", "present", "text"}, or at the end {"error", "status", "steps"}.
    """

    RUNNING: tuple[str, ...] = ()  # states

    def __init__(self):
        self.state = self.text = self.error = ""
        self.total = self.present = 0
        self.status: int | None = None
        self.steps: list[tuple[str, str]] = []  # what helps, and the address of its web page or ""

    @property
    def is_running(self) -> bool:
        return self.state in self.RUNNING

    @property
    def silent_seconds(self) -> float:
        """Seconds since the last message."""
        return time.monotonic() - self._last_message

    @property
    def explanation(self) -> str:
        """The error with the steps that help, where there are no buttons for them."""
        steps = (f"{i}. {text} ({page})" if page else f"{i}. {text}" for i, (text, page) in enumerate(self.steps, 1))
        return ". ".join([self.error, *steps])

    def cancel(self) -> None:
        """End the process now."""
        if self.is_running:
            self._cancelled = True
            self._process.kill()
            self._reader.join()
        self.state = "cancelled"

    def end(self) -> None:
        """End the process and come back when it has ended."""
        self.cancel()

    def wait(self, seconds: float | None = None) -> None:
        """Wait until it has ended; for scripts, which have no window that could freeze."""
        self._reader.join(seconds)

    def _start(self, state: str, afterwards: str, command: list[str], request: dict, environment=None) -> None:
        """Raises OSError when no process can be started."""
        self._cancelled, self._last_message = False, time.monotonic()
        self._process = subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                         encoding="utf-8", creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0))
        self.state = state
        self._reader = threading.Thread(target=self._read, args=(request, afterwards), daemon=True)
        self._reader.start()

    def _read(self, request: dict, afterwards: str) -> None:
        try:  # through a pipe: command lines and environments can be seen by others
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
        except (OSError, ValueError):
            pass  # it has ended already: its exit code is read below
        for line in self._process.stdout:
            message = json.loads(line)
            self._last_message = time.monotonic()
            self.error, self.status = message.get("error", ""), message.get("status")
            self.steps = message.get("steps", [])
            if not self.error:
                self.total, self.present, self.text = (message[key] for key in ("total", "present", "text"))
        self._process.stdout.close()
        code = self._process.wait()
        self._close_input()
        if self._cancelled:
            self.state = "cancelled"
        elif code:
            self.error = self.error or f"The program ended with code {code}: see the console"
            self.state = "failed"
        else:
            self.state = afterwards

    def _close_input(self) -> None:
        try:
            self._process.stdin.close()
        except OSError:
            pass  # it has closed its end


class CurrentProcess:
    """The one process of a kind that panels show, if there is any."""

    def __init__(self, kind: type[WorkerProcess]):
        self._kind = kind
        self.process: WorkerProcess | None = None

    @property
    def is_running(self) -> bool:
        return self.process is not None and self.process.is_running

    def begin(self, *arguments, **options) -> WorkerProcess:
        """Start a process with the arguments of its class, in place of the last one."""
        self.forget()
        self.process = self._kind(*arguments, **options)
        return self.process

    def forget(self) -> None:
        """End the process if it runs, and go back to the beginning."""
        if self.process:
            self.process.end()
        self.process = None
