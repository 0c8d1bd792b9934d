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

from ..progress import report
from .teams import POLL, Team, in_turn

# For GNU's and LLVM's library, and for Intel's.
_SLEEP = {"OMP_WAIT_POLICY": "PASSIVE", "KMP_BLOCKTIME": "0"}
_CHOSEN_BY_USER = (*_SLEEP, "GOMP_SPINCOUNT")
_GRAIN = 1 << 15  # elements of a tensor that PyTorch does not share between threads

_this = threading.local()  # has `most`, how many threads may share this one's work, where that is known
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
        return in_turn(function, rows)
    pieces, threads = current_pieces(), torch.get_num_threads()

    def one(*row):
        with inference(pieces):  # which holds for one thread
            return function(*row)

    try:
        return Team.of_this_thread(threads).run(one, rows, functools.partial(torch.set_num_threads, 1))
    finally:
        torch.set_num_threads(threads)  # new threads inherit the last number that was set


@contextmanager
def undivided_operations():
    """Inside, PyTorch does not divide operations of this thread, but `shared` rows are those of its whole team.

    For small operations: to wake a thread that sleeps takes longer than it saves. May decorate a function.
    """
    import torch
    threads = torch.get_num_threads()
    with Team.of_this_thread(threads).worked_in():
        torch.set_num_threads(1)
        try:
            yield
        finally:
            torch.set_num_threads(threads)


def spread(function: Callable, rows: Sequence[tuple]) -> list:
    """[function(*row) for row in rows] on as many threads as this one's team has, for functions without PyTorch.

    They gain from it if they let go of Python's lock. What is reported is as of `shared`.
    """
    return Team.of_this_thread(_team_size()).run(function, rows)


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
