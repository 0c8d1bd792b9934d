# SPDX-License-Identifier: GPL-3.0-or-later
"""Threads that work on the same rows and help each other: `Team`."""
from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from contextlib import contextmanager

from ..progress import part, report, reporting, steps

POLL = 0.05  # seconds between two progress reports of a thread that waits

_this = threading.local()  # has `team`, whose rows this thread works on, if any


class Team:
    """Threads that may work at once on rows, and on rows that these share in turn; this thread is one of them."""

    def __init__(self, size: int):
        self.size, self._free, self._lock = size, size - 1, threading.Lock()

    @staticmethod
    def of_this_thread(size: int) -> Team:
        """The team whose rows this thread works on, or a new one."""
        return getattr(_this, "team", None) or Team(size)

    def run(self, function: Callable, rows: Sequence[tuple], begin: Callable[[], object] = lambda: None) -> list:
        """[function(*row) for row in rows]; `begin` is called in each thread that works on them."""
        if self.size == 1 or len(rows) < 2:
            return in_turn(function, rows)
        work, helpers = _Rows(function, rows), []

        def help_out():
            try:
                begin()
                with self.worked_in(), reporting(work.check):
                    work.do()
            except BaseException as error:  # said by the thread that waits
                work.fail(error)
            finally:
                self._leave()

        def ask_for_help():
            while work.is_left and self._join():
                helpers.append(threading.Thread(target=help_out, daemon=True))
                helpers[-1].start()

        try:
            begin()
            with self.worked_in():
                work.do(ask_for_help)
                self._leave()  # others may work while this thread waits
                try:
                    for helper in helpers:
                        while helper.is_alive():
                            report()
                            helper.join(POLL)
                finally:
                    self._join(wanted=True)
        except BaseException as error:
            work.fail(error)
            raise
        finally:
            for helper in helpers:
                helper.join()
        return work.results()

    @contextmanager
    def worked_in(self):
        """Inside, what this thread shares, it shares with the team."""
        before, _this.team = getattr(_this, "team", None), self
        try:
            yield
        finally:
            _this.team = before

    def _join(self, wanted: bool = False) -> bool:
        """Take the place of a thread, if one is free, or is `wanted`."""
        with self._lock:
            is_in = wanted or self._free > 0
            self._free -= is_in
            return is_in

    def _leave(self) -> None:
        with self._lock:
            self._free += 1


class _Rows:
    """Rows that several threads work on."""

    def __init__(self, function: Callable, rows: Sequence[tuple]):
        self._function, self._rows, self._results = function, rows, [None] * len(rows)
        self._next, self._errors, self._lock = 0, [], threading.Lock()

    @property
    def is_left(self) -> bool:
        return self._next < len(self._rows) and not self._errors

    def do(self, before_each: Callable[[], object] = lambda: None) -> None:
        """Work on what is left."""
        count = len(self._rows)
        while (i := self._take()) is not None:
            before_each()
            with part(i / count, (i + 1) / count):
                report(0.0)
                self._results[i] = self._function(*self._rows[i])

    def check(self, text: str, fraction: float) -> None:
        """Hear of progress, and end the work of a thread if another has failed."""
        if self._errors:
            raise _Stopped

    def fail(self, error: BaseException) -> None:
        """Leave what has not begun."""
        self._errors.append(error)

    def results(self) -> list:
        if self._errors:
            raise self._errors[0]
        return self._results

    def _take(self) -> int | None:
        with self._lock:
            if not self.is_left:
                return None
            self._next += 1
            return self._next - 1


class _Stopped(Exception):
    """Another thread has failed."""


def in_turn(function: Callable, rows: Sequence[tuple]) -> list:
    return [function(*row) for row in steps(rows)]
