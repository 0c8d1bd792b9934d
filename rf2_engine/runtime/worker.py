# SPDX-License-Identifier: GPL-3.0-or-later
"""The one thread that pictures of viewports are made on, so that Blender's window never waits for them."""
from __future__ import annotations

import sys
import threading
import weakref
from contextlib import contextmanager
from typing import Protocol

from . import running

SWITCH = 0.0005       # seconds after which Python's lock is passed on while this thread works, instead of 0.005
LONGEST_STOP = 10.0   # seconds; until a piece of work has noticed that it is to end
POLL = 0.05           # seconds


class Stopped(Exception):
    """Raised in a piece of work to end it."""


class Work(Protocol):
    requested_at: float  # when something was last requested of it

    def has_work(self) -> bool:
        """Whether there is something left to do."""

    def step(self, listen) -> None:
        """Do a piece of it; `listen` raises Stopped if all work is to end."""


class Worker:
    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._all: list[weakref.ref] = []
        self._thread: threading.Thread | None = None
        self._stopping = self._is_busy = False

    def add(self, work: Work) -> None:
        """Do its pieces from now on, until nothing else refers to it."""
        with self._changed:
            self._all = [reference for reference in self._all if reference() is not None] + [weakref.ref(work)]

    def wake(self) -> None:
        """There is something to do; to be called on the main thread."""
        with self._changed:
            if self._thread is None:
                self._stopping = False
                self._thread = threading.Thread(target=self._run, name="RenderFormer-V2 viewport", daemon=True)
                self._thread.start()
            self._changed.notify_all()

    def wait_until_idle(self, longest: float = POLL) -> bool:
        """Wait until the work under way has ended, `longest` seconds at most; False if it has not.

        No other work begins while a render runs.
        """
        with self._changed:
            return self._changed.wait_for(lambda: not self._is_busy, longest)

    def stop(self) -> None:
        """End the thread; `wake` starts another one."""
        with self._changed:
            thread, self._thread, self._stopping = self._thread, None, True
            self._all.clear()
            self._changed.notify_all()
        if thread is not None:
            thread.join(LONGEST_STOP)

    def works(self) -> list:
        """All that are still alive, on any thread."""
        return [work for reference in self._all if (work := reference()) is not None]

    def _listen(self, *_) -> None:
        if self._stopping or running.is_under_way():
            raise Stopped()

    def _next(self) -> Work | None:
        waiting = [] if running.is_under_way() else [work for work in self.works() if work.has_work()]
        return max(waiting, key=lambda work: work.requested_at, default=None)

    def _run(self) -> None:
        this = threading.current_thread()
        while True:
            with self._changed:
                self._is_busy = False
                self._changed.notify_all()
                while self._thread is this and (work := self._next()) is None:
                    self._changed.wait()
                if self._thread is not this:
                    return
                self._is_busy = True
            with _switching_often():
                work.step(self._listen)
            del work


@contextmanager
def _switching_often():
    """Give the window Python's lock sooner inside: it needs it for every panel that it draws."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(min(SWITCH, before))
    try:
        yield
    finally:
        sys.setswitchinterval(before)


worker = Worker()
