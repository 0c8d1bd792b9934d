# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure the memory that this process uses, including the network."""
from __future__ import annotations

import ctypes
import os
import sys
from pathlib import Path

MEBI = 1 << 20


def measure() -> tuple[float, float]:
    """Mebibytes in use now, and the peak so far; the peak twice where there is no figure of now."""
    if sys.platform == "win32":
        return _measure_on_windows()
    import resource  # missing on Windows
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    peak = peak / MEBI if sys.platform == "darwin" else peak / 1024
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except (OSError, ValueError, IndexError):
        return peak, peak
    now = pages * os.sysconf("SC_PAGE_SIZE") / MEBI
    return now, max(now, peak)


class _Counters(ctypes.Structure):
    """PROCESS_MEMORY_COUNTERS of Windows' psapi."""

    _fields_ = [("size", ctypes.c_ulong), ("faults", ctypes.c_ulong)] + [(name, ctypes.c_size_t) for name in (
        "peak", "now", "paged_peak", "paged", "other_peak", "other", "file", "file_peak")]


def _measure_on_windows() -> tuple[float, float]:
    counters = _Counters(size=ctypes.sizeof(_Counters))
    kernel = ctypes.windll.kernel32
    kernel.GetCurrentProcess.restype = ctypes.c_void_p
    kernel.K32GetProcessMemoryInfo.argtypes = ctypes.c_void_p, ctypes.c_void_p, ctypes.c_ulong
    kernel.K32GetProcessMemoryInfo(kernel.GetCurrentProcess(), ctypes.byref(counters), counters.size)
    return counters.now / MEBI, counters.peak / MEBI
