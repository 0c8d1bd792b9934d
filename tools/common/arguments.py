# SPDX-License-Identifier: GPL-3.0-or-later
"""Types and checks of command line arguments."""
from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path


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
