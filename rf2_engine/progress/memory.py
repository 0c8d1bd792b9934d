# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure the memory that this process uses, including the network."""
from __future__ import annotations

import ctypes
import os
import sys
from pathlib import Path

MEBI = 1 << 20


def held() -> tuple[float, float]:
    """Mebibytes in use now, and at most so far; without an own figure of now, the most twice."""
    if sys.platform == "win32":
        return _on_windows()
    import resource  # Windows has none
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    most = most / MEBI if sys.platform == "darwin" else most / 1024
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except (OSError, ValueError, IndexError):
        return most, most
    now = pages * os.sysconf("SC_PAGE_SIZE") / MEBI
    return now, max(now, most)


class _Counters(ctypes.Structure):
    """PROCESS_MEMORY_COUNTERS of Windows' psapi."""

    _fields_ = [("size", ctypes.c_ulong), ("faults", ctypes.c_ulong)] + [(name, ctypes.c_size_t) for name in (
        "most", "now", "paged_most", "paged", "other_most", "other", "file", "file_most")]


def _on_windows() -> tuple[float, float]:
    counters = _Counters(size=ctypes.sizeof(_Counters))
    kernel = ctypes.windll.kernel32
    kernel.GetCurrentProcess.restype = ctypes.c_void_p
    kernel.K32GetProcessMemoryInfo.argtypes = ctypes.c_void_p, ctypes.c_void_p, ctypes.c_ulong
    kernel.K32GetProcessMemoryInfo(kernel.GetCurrentProcess(), ctypes.byref(counters), counters.size)
    return counters.now / MEBI, counters.most / MEBI
