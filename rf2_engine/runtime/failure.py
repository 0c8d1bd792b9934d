# SPDX-License-Identifier: GPL-3.0-or-later
"""The message that the user gets if a render fails."""
from __future__ import annotations

import traceback

from ...model.errors import CheckpointError, SceneError
from ..setup.packages import MissingPackages

FOR_USERS = (CheckpointError, MissingPackages, SceneError)
# PyTorch's allocators of the CPU, of CUDA and of Metal, and its matrix library on CUDA.
_NO_MEMORY = ("can't allocate memory", "not enough memory", "out of memory", "alloc_failed")


def message(error: Exception) -> str:
    """A sentence with what to do; for a fault of ours it goes with a traceback on the console."""
    if isinstance(error, FOR_USERS):
        return str(error)
    if is_out_of_memory(error):
        on_cpu = isinstance(error, MemoryError) or "cpu" in str(error).lower()
        return ("Out of memory: lower Max Triangles or the resolution"
                + (", or close other programs" if on_cpu else ", or set Device to CPU"))
    traceback.print_exception(error)
    return f"Internal error, please report it with the console's text: {error!r}"


def is_out_of_memory(error: Exception) -> bool:
    """True for Python's and numpy's MemoryError, and for what PyTorch raises on any device."""
    if isinstance(error, MemoryError) or type(error).__name__ == "OutOfMemoryError":
        return True
    return isinstance(error, RuntimeError) and any(words in str(error).lower() for words in _NO_MEMORY)
