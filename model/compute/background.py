# SPDX-License-Identifier: GPL-3.0-or-later
"""Imports that take seconds, on a thread, so that the caller can do other work or poll for Esc.

Imports only: every thread that computes with PyTorch keeps a team of threads of its own, and two of them on one
processor halve its speed.
"""
from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor, wait

from ..progress import report

POLL = 0.05  # seconds

_thread = ThreadPoolExecutor(1, "RenderFormer-V2 imports")


def begin(function) -> Future:
    """Start function(), which imports something and returns it."""
    return _thread.submit(function)


def finish(future: Future):
    """What it returned or raised. Progress is reported until then, which may cancel; the import goes on."""
    while not wait([future], POLL).done:
        report()
    return future.result()
