# SPDX-License-Identifier: GPL-3.0-or-later
"""What is set once in a process that computes pictures: how its threads wait, and how it keeps memory."""
from __future__ import annotations

import ctypes
import os
import platform

from .threads import sleep_while_waiting

# mallopt's parameters of GNU's C library. It gives blocks from KEPT_BLOCK on back to the system at once, and the top of
# its memory from KEPT_MEMORY on; arrays of pictures then cost a page fault for every 4 kB of every operation, which is
# up to a tenth of a frame.
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
KEPT_BLOCK = 32 << 20    # bytes, the most that the library allows, and what it comes to itself in time
KEPT_MEMORY = 256 << 20  # bytes
_CHOSEN_BY_USER = "GLIBC_TUNABLES", "MALLOC_TRIM_THRESHOLD_", "MALLOC_MMAP_THRESHOLD_"


def prepare() -> None:
    """To be called before PyTorch is imported. What the environment says holds."""
    sleep_while_waiting()
    keep_freed_memory()


def keep_freed_memory() -> bool:
    """Keep memory that was freed for what is computed next; whether that is so. Only GNU's C library has to be told."""
    if platform.libc_ver()[0] != "glibc" or any(name in os.environ for name in _CHOSEN_BY_USER):
        return False
    mallopt = ctypes.CDLL(None).mallopt
    return bool(mallopt(_MMAP_THRESHOLD, KEPT_BLOCK) and mallopt(_TRIM_THRESHOLD, KEPT_MEMORY))
