# SPDX-License-Identifier: GPL-3.0-or-later
"""What the command lines accept as a number."""
from __future__ import annotations

import argparse
from collections.abc import Callable


def whole_number(least: int) -> Callable[[str], int]:
    """A `type` of argparse: decimal whole numbers from `least` (0 or more)."""
    def parse(text: str) -> int:
        if not (text.isascii() and text.isdecimal()) or int(text) < least:
            raise argparse.ArgumentTypeError(f"{text}: expected a whole number from {least}")
        return int(text)
    return parse
