# SPDX-License-Identifier: GPL-3.0-or-later
"""What a command takes and prints: types of arguments, its answer alone on stdout, errors in one line."""
from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Callable
from pathlib import Path
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
    """Send stdout to an open file, or to nowhere; also that of C code."""
    if target is not None:
        os.dup2(target, 1)
        return
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    os.close(null)


def whole_number(least: int) -> Callable[[str], int]:
    """A `type` of argparse: decimal whole numbers from `least` (0 or more)."""
    def parse(text: str) -> int:
        if not (text.isascii() and text.isdecimal()) or int(text) < least:
            raise argparse.ArgumentTypeError(f"{text}: expected a whole number from {least}")
        return int(text)
    return parse


def numbers(text: str) -> tuple[int, ...]:
    """A `type` of argparse: "512,1024"."""
    return tuple(map(int, text.split(",")))


def device_name(text: str) -> str:
    """A `type` of argparse: "auto", "cpu", "mps", "cuda" or "cuda:1"."""
    if not re.fullmatch(r"auto|cpu|mps|cuda(:\d+)?", text):
        raise argparse.ArgumentTypeError(f"{text}: expected auto, cpu, cuda, cuda:1 or mps")
    return text


def file_with(*suffixes: str):
    """Parses an absolute path that ends in one of `suffixes`."""
    def parse(text: str) -> Path:
        path = Path(text).resolve()
        if path.suffix.lower() not in suffixes:
            raise argparse.ArgumentTypeError(f"{text}: the suffix must be one of {', '.join(suffixes)}")
        return path
    return parse


def picture_size(text: str) -> tuple[int, int]:
    """A `type` of argparse: "640x480", width and height in pixels."""
    sides = text.lower().split("x")
    if len(sides) != 2:
        raise argparse.ArgumentTypeError(f"{text}: expected WIDTHxHEIGHT, such as 640x480")
    count = whole_number(1)
    return count(sides[0]), count(sides[1])
