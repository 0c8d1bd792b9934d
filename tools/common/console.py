# SPDX-License-Identifier: GPL-3.0-or-later
"""What a command prints: its answer alone on stdout, without Blender's own lines, and errors in one line."""
from __future__ import annotations

import os
import sys
from typing import TextIO


def silence_blender() -> None:
    """Send what Blender's C code prints (30 lines a render) to nowhere; Python's `print` still reaches the console."""
    sys.stdout.flush()
    sys.stdout = os.fdopen(os.dup(1), "w", buffering=1)
    _redirect_stdout(None)


def reserve_stdout(*, is_verbose: bool = False) -> TextIO:
    """A file for the answer on stdout. All else that this process prints goes to stderr, or to nowhere.

    is_verbose: to stderr.
    """
    answer = os.fdopen(os.dup(1), "w")
    _redirect_stdout(2 if is_verbose else None)
    return answer


def to_one_line(error: Exception) -> str:
    """What an exception says; Blender's say it several times, each time as an error."""
    messages = dict.fromkeys(line.removeprefix("Error: ").strip() for line in str(error).splitlines())
    return " ".join(filter(None, messages))


def _redirect_stdout(target: int | None) -> None:
    """To an open file, or to nowhere; also for C code."""
    if target is not None:
        os.dup2(target, 1)
        return
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    os.close(null)
