# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures worked on in horizontal bands, so that a large one costs little more memory than a small one."""
from __future__ import annotations

from collections.abc import Iterator

from ..progress import report

PIXELS = 1 << 18  # of a band; also what lies between two looks at the Esc key


def bands(height: int, width: int, margin: int, pixels: int = PIXELS,
          multiple: int = 1) -> Iterator[tuple[slice, slice]]:
    """For every band: its rows with `margin` more on either side, as far as there are, and which of these are its own.

    pixels: of a band without its margins. multiple: of it every band begins at a row.
    Reports progress, which may cancel.
    """
    rows = max(pixels // width // multiple, 1) * multiple
    for begin in range(0, height, rows):
        report(begin / height)
        first, end = max(begin - margin, 0), min(begin + rows, height)
        yield slice(first, min(end + margin, height)), slice(begin - first, end - first)
