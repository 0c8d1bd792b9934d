# SPDX-License-Identifier: GPL-3.0-or-later
"""Process long sequences in pieces: this bounds memory, and every piece reports progress (which may cancel)."""
from __future__ import annotations

from collections.abc import Callable

import torch

from ..progress import part, report
from .buffers import like

# Rows per chunk: large enough for the matrix products, small enough that a chunk takes well under 0.2 s and that the
# element-wise work between the products stays in the processor's cache.
CHUNK = 512
GPU_CHUNK = 4096


SMALLEST = 16   # part of the usual pieces that is tried last
_divisor = 1    # of the pieces on a card, since its memory ran out


def chunk_for(device: torch.device) -> int:
    return GPU_CHUNK // _divisor if device.type == "cuda" else CHUNK


def divided(size: int) -> int:
    """The same, or as much less as the memory of a card asked for."""
    return max(size // _divisor, 1)


def smaller() -> bool:
    """From now on pieces are a quarter as large; False when they are as small as they get."""
    global _divisor
    if _divisor >= SMALLEST:
        return False
    _divisor *= 4
    return True


def usual() -> None:
    """Pieces of the usual size again."""
    global _divisor
    _divisor = 1


def is_divided() -> bool:
    return _divisor > 1


def cuts(begin: int, end: int, device: torch.device) -> list[slice]:
    """begin..end in pieces that are computed one after the other: a single one where gradients are wanted."""
    size = max(end - begin, 1) if torch.is_grad_enabled() else chunk_for(device)
    return [slice(first, min(first + size, end)) for first in range(begin, end, size)]


def by_rows(function: Callable[[slice], torch.Tensor], pieces: list[slice],
            into: torch.Tensor | None = None) -> torch.Tensor:
    """function(rows) of all pieces of a sequence, one below the other.

    into: memory for the result, if the rows of a piece are made of nothing there but themselves; with gradients it is
    left alone. Memory that is new to the process costs as much time as an attention.
    """
    length, result = pieces[-1].stop, into
    if torch.is_grad_enabled():
        return torch.cat([function(rows) for rows in pieces])
    for rows in pieces:
        with part(rows.start / length, rows.stop / length):
            report()
            done = function(rows)
        if len(done) == length:
            return done
        result = like(done, length, 0) if result is None else result
        result[rows] = done
    return result


def chunked(function, *tensors: torch.Tensor, size: int = 0, axis: int = 0, into: torch.Tensor | None = None):
    """function(*tensors), computed for `size` rows (0: as suit the device) at a time and concatenated along `axis`.

    `function` returns a tensor or a tuple of tensors with as many rows (on that axis) as it was given. into: as for
    `by_rows`.
    """
    rows, size = len(tensors[0]), size or chunk_for(tensors[0].device)
    if torch.is_grad_enabled():
        size = max(rows, 1)  # autograd would hold a gradient of full length for every slice
    results = None if into is None else [into]
    for begin in range(0, max(rows, 1), size):
        report(begin / max(rows, 1))
        result = function(*(t[begin:begin + size] for t in tensors))
        if size >= rows:
            return result
        parts = result if isinstance(result, tuple) else (result,)
        results = results or [like(piece, rows, axis) for piece in parts]
        for whole, piece in zip(results, parts):
            whole.narrow(axis, begin, piece.shape[axis]).copy_(piece)
    return tuple(results) if isinstance(result, tuple) else results[0]
