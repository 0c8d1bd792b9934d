# SPDX-License-Identifier: GPL-3.0-or-later
"""Threads: those that PyTorch computes with on the CPU (their number, and that they sleep while they wait), and one for
imports that take seconds.

By default a waiting OpenMP thread spins for some milliseconds. If another program uses the processor, it spins on the
core that the thread it waits for needs, and work that takes 2 s takes 20.
"""
from __future__ import annotations

import functools
import os
import sys
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, nullcontext

from ..progress import part, report, reporting, steps

# For GNU's and LLVM's library, and for Intel's.
_SLEEP = {"OMP_WAIT_POLICY": "PASSIVE", "KMP_BLOCKTIME": "0"}
_CHOSEN_BY_USER = (*_SLEEP, "GOMP_SPINCOUNT")
_GRAIN = 1 << 15  # elements of a tensor that PyTorch does not share between threads
POLL = 0.05  # seconds between two progress reports

_this = threading.local()  # has `most`, how many threads may share this one's work, and the `team` that does, if any
_importing = ThreadPoolExecutor(1, "RenderFormer-V2 imports")


class Waiting:
    """How OpenMP's threads wait in this process."""

    sleeps_by_us = False  # whether `sleep_while_waiting` made them sleep


def sleep_while_waiting() -> None:
    """Make waiting threads sleep, unless the environment says how they wait. To be called before PyTorch is imported.

    It holds for OpenMP libraries that are loaded from now on, which PyTorch's own package brings; for the others there
    is `team`.
    """
    if not any(name in os.environ for name in _CHOSEN_BY_USER):
        os.environ.update(_SLEEP)
        Waiting.sleeps_by_us = True


@contextmanager
def team(count: int = 0):
    """Inside, this thread computes with `count` threads, or with as many as PyTorch chose for 0.

    They sleep while they wait even if the OpenMP library was there before `sleep_while_waiting`, as in a Blender that
    shares the system's.
    """
    import torch
    before = torch.get_num_threads()
    if count:
        torch.set_num_threads(count)
    try:
        with _crowd(count or before) if Waiting.sleeps_by_us else nullcontext():
            yield
    finally:
        if count:
            torch.set_num_threads(before)


def shared(function: Callable, *columns: Sequence, device=None) -> list:
    """[function(*row) for row in zip(*columns)], the rows shared between the threads of this one's team.

    For long rows of small operations, which PyTorch's own threads would share one by one or not at all. Rows may share
    rows of their own: threads that find none left help there. A GPU works on one row after the other, and so does
    training (inference.py). What is reported is how many rows are begun, and what this thread's rows report.
    device: that computes; the one of the first column's tensors when not given.
    """
    import torch

    from .inference import current_pieces, inference, is_inference
    rows = list(zip(*columns, strict=True))
    if len(rows) < 2 or not is_inference() or (device or rows[0][0].device).type != "cpu":
        return _in_turn(function, rows)
    pieces, threads = current_pieces(), torch.get_num_threads()

    def one(*row):
        with inference(pieces):  # which holds for one thread
            return function(*row)

    try:
        return _Team.of_this_thread(threads).run(one, rows, functools.partial(torch.set_num_threads, 1))
    finally:
        torch.set_num_threads(threads)  # new threads inherit the last number that was set


@contextmanager
def undivided_operations():
    """Inside, PyTorch does not divide operations of this thread, but `shared` rows are those of its whole team.

    For small operations: to wake a thread that sleeps takes longer than it saves. May decorate a function.
    """
    import torch
    threads = torch.get_num_threads()
    with _Team.of_this_thread(threads).worked_in():
        torch.set_num_threads(1)
        try:
            yield
        finally:
            torch.set_num_threads(threads)


def spread(function: Callable, rows: Sequence[tuple]) -> list:
    """[function(*row) for row in rows] on as many threads as this one's team has, for functions without PyTorch.

    They gain from it if they let go of Python's lock. What is reported is as of `shared`.
    """
    return _Team.of_this_thread(_team_size()).run(function, rows)


class _Team:
    """Threads that may work at once on rows, and on rows that these share in turn; this thread is one of them."""

    def __init__(self, size: int):
        self.size, self._free, self._lock = size, size - 1, threading.Lock()

    @staticmethod
    def of_this_thread(size: int) -> _Team:
        """The team whose rows this thread works on, or a new one."""
        return getattr(_this, "team", None) or _Team(size)

    def run(self, function: Callable, rows: Sequence[tuple], begin: Callable[[], object] = lambda: None) -> list:
        """[function(*row) for row in rows]; `begin` is called in each thread that works on them."""
        if self.size == 1 or len(rows) < 2:
            return _in_turn(function, rows)
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


class Once:
    """A value that the first of several threads makes for all of them, unless it is given."""

    def __init__(self, value=None):
        self._value, self._lock = value, threading.Lock()

    def get(self, make: Callable):
        with self._lock:
            if self._value is None:
                self._value = make()
            return self._value


@contextmanager
def limited(count: int):
    """Inside, `spread` shares this thread's work between `count` threads at most; 0 sets no limit."""
    before = getattr(_this, "most", 0)
    _this.most = count
    try:
        yield
    finally:
        _this.most = before


def _team_size() -> int:
    """How many threads share this one's work: as many as PyTorch has, unless limited."""
    if getattr(_this, "most", 0):
        return _this.most
    torch = sys.modules.get("torch")
    return torch.get_num_threads() if hasattr(torch, "get_num_threads") else os.cpu_count() or 1


def _in_turn(function: Callable, rows: Sequence[tuple]) -> list:
    return [function(*row) for row in steps(rows)]


@contextmanager
def _crowd(count: int):
    """Inside, GNU's library has more threads than the machine has cores, if only sleeping ones.

    That makes it wait without spinning (its "throttled" spin count), and nothing else does once it is loaded.
    """
    teams = ((os.cpu_count() or 1) - 1) // (count - 1) if count > 1 else 0  # each adds count - 1, as ours does
    started, done = threading.Semaphore(0), threading.Event()
    members = [threading.Thread(target=_idle_team, args=(count, started, done), daemon=True) for _ in range(teams)]
    try:
        for member in members:
            member.start()
            started.acquire()
        yield
    finally:
        done.set()
        for member in members:
            member.join()


def _idle_team(count: int, started: threading.Semaphore, done: threading.Event) -> None:
    """A thread whose team of `count` threads has worked once and waits for more until `done`."""
    import torch
    try:
        torch.zeros(count * _GRAIN, dtype=torch.uint8).add_(1)
    finally:
        started.release()
    done.wait()


def begin_import(function: Callable) -> Future:
    """Start function(), which imports something and returns it, on a thread, so that the caller can do other work.

    Imports only: every thread that computes with PyTorch keeps a team of threads of its own, and two of them on one
    processor halve its speed.
    """
    return _importing.submit(function)


def finish(future: Future):
    """What the function returned or raised. Progress is reported until then, which may cancel; the function goes on."""
    while not wait([future], POLL).done:
        report()
    return future.result()
