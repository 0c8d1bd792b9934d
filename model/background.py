# SPDX-License-Identifier: GPL-3.0-or-later
"""Imports that take seconds, on a thread, so that the caller can do other work or poll for Esc.

Imports only: every thread that computes with PyTorch keeps a team of threads of its own, and two of them on one
processor halve its speed.
"""
from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor, wait

POLL = 0.05  # seconds

_thread = ThreadPoolExecutor(1, "RenderFormer-V2 imports")


def begin(function) -> Future:
    """Start function(), which imports something and returns it."""
    return _thread.submit(function)


def finish(future: Future, poll=lambda: None):
    """What it returned or raised. poll() is called until then and may raise; the import goes on."""
    while not wait([future], POLL).done:
        poll()
    return future.result()
