# SPDX-License-Identifier: GPL-3.0-or-later
"""Keeps Blender quiet in programs that use the bpy module."""
from __future__ import annotations

import os
import sys


def silence_blender() -> None:
    """Send what Blender's C code prints (30 lines a render) to nowhere; Python's `print` still reaches the console."""
    sys.stdout.flush()
    sys.stdout = os.fdopen(os.dup(1), "w", buffering=1)
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    os.close(null)
