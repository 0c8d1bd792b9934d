# SPDX-License-Identifier: GPL-3.0-or-later
"""Inference says so itself: what bounds memory and keeps no gradients is chosen inside `inference()`, and only there.

    with inference():                           # a renderer: `inference(self.pieces)`
        context = network.encode_scene(inputs)

Inside, PyTorch records no gradients (`torch.inference_mode`), and
- long sequences and large pictures are computed in pieces (`cuts`, `by_rows`, `chunked`, and bands of the decoder and
  of ray tokens), between which progress is reported, which may cancel;
- results may take the place of inputs that are not needed any more (`into`);
- attention on the CPU runs over blocks of keys that stay in its caches (network/block_attention.py);
- pieces, and rows of small operations, are shared between threads (`threads.shared`).
Outside, all is computed whole and gradients pass through it, whether they are recorded or not: training, its validation
and gradient tests need to say nothing. Code that has to choose asks `is_inference()`.

The renderer decides how large the pieces are: `Pieces`.
"""
from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

import numpy as np
import torch

from ..progress import standing_still
from .devices import free_memory
from .threads import Once, shared

# Rows per piece: large enough for the matrix products, small enough that a piece takes well under 0.2 s and that the
# element-wise work between the products stays in the processor's cache.
CHUNK = 512
GPU_CHUNK = 4096
ROW_BYTES = 56 << 10  # of a card, for a row of a sequence while a layer of the published network is computed
SHARE = 0.5           # of a card's free memory that such rows may take: keys, values and features are kept beside them
HUGE = 1 << 22  # bytes: numpy asks the system for huge pages from here on


class Pieces:
    """How large the pieces of a renderer are. They shrink when the memory of its card runs out."""

    SMALLEST = 16  # part of the usual size that is tried last

    def __init__(self) -> None:
        self._divisor = 1

    @property
    def are_small(self) -> bool:
        """Whether they have shrunk."""
        return self._divisor > 1

    def shrink(self) -> bool:
        """Make them a quarter as large; False when they are as small as they get."""
        if self._divisor >= self.SMALLEST:
            return False
        self._divisor *= 4
        return True

    def rows(self, device: torch.device) -> int:
        """Rows of a sequence in a piece."""
        return self.limit(GPU_CHUNK) if device.type == "cuda" else CHUNK

    def sequence_rows(self, device: torch.device, usual: int = 0) -> int:
        """Rows of the transformer's sequences in a piece: on a card as many as its free memory is enough for, elsewhere
        `usual` (0: as all else there)."""
        if device.type != "cuda":
            return usual or self.rows(device)
        return self.rows(device) if self.are_small else max(rows_that_fit(device), GPU_CHUNK)

    def limit(self, size: int) -> int:
        """What becomes of any other size on a card."""
        return max(size // self._divisor, 1)


def rows_that_fit(device: torch.device) -> int:
    """Rows of a sequence that a card has memory for at this moment."""
    return int(SHARE * free_memory(device)) // ROW_BYTES


_pieces: ContextVar[Pieces | None] = ContextVar("pieces", default=None)


@contextmanager
def inference(pieces: Pieces | None = None) -> Iterator[None]:
    """Inside, this thread computes as the module describes. May decorate a function.

    pieces: of the surrounding `inference()`, or of the usual size, when not given.
    """
    token = _pieces.set(pieces or current_pieces())
    try:
        with torch.inference_mode():
            yield
    finally:
        _pieces.reset(token)


def is_inference() -> bool:
    """Whether this thread is inside `inference()`."""
    return _pieces.get() is not None


def current_pieces() -> Pieces:
    """The pieces of the surrounding `inference()`; of the usual size outside."""
    return _pieces.get() or Pieces()


def cuts(begin: int, end: int, device: torch.device) -> list[slice]:
    """begin..end of a sequence in pieces that are computed one after the other: a single one outside of `inference()`,
    and on a card with enough memory."""
    size = current_pieces().sequence_rows(device) if is_inference() else max(end - begin, 1)
    return [slice(first, min(first + size, end)) for first in range(begin, end, size)]


def by_rows(function: Callable[[slice], torch.Tensor], pieces: list[slice], device: torch.device,
            into: torch.Tensor | None = None) -> torch.Tensor:
    """function(rows) of all pieces of a sequence, one below the other; on the CPU, threads share them.

    into: memory for the result, if the rows of a piece are computed from nothing there but themselves; left alone
    outside of `inference()`.
    """
    if not is_inference():
        return torch.cat([function(rows) for rows in pieces])
    length, result = pieces[-1].stop, Once(into)

    def compute(rows: slice) -> torch.Tensor:
        piece = function(rows)
        if len(piece) == length:
            return piece
        whole = result.get(lambda: like(piece, length, 0))
        whole[rows] = piece
        return whole

    return shared(compute, pieces, device=device)[-1]


def chunked(function: Callable, *tensors: torch.Tensor, size: int = 0, axis: int = 0,
            into: torch.Tensor | None = None):
    """function(*tensors), computed for `size` rows (0: as suit the device) at a time and concatenated along `axis`.

    `function` returns a tensor or a tuple of tensors with as many rows (on that axis) as its arguments. into: as for
    `by_rows`. On the CPU, threads share the chunks.
    """
    rows, device = len(tensors[0]), tensors[0].device
    size = (size or current_pieces().rows(device)) if is_inference() else max(rows, 1)
    results = Once(None if into is None else [into])

    def compute(begin: int):
        result = function(*(t[begin:begin + size] for t in tensors))
        if size >= rows:
            return result
        pieces = result if isinstance(result, tuple) else (result,)
        whole = results.get(lambda: [like(piece, rows, axis) for piece in pieces])
        for full, piece in zip(whole, pieces):
            full.narrow(axis, begin, piece.shape[axis]).copy_(piece)
        return tuple(whole) if isinstance(result, tuple) else whole[0]

    with standing_still():
        return shared(compute, range(0, max(rows, 1), size), device=device)[-1]


def like(piece: torch.Tensor, length: int, axis: int) -> torch.Tensor:
    """Room for `length` rows of what `piece` holds some of."""
    return room((*piece.shape[:axis], length, *piece.shape[axis + 1:]), piece)


def room(shape: tuple[int, ...], like: torch.Tensor) -> torch.Tensor:
    """Uninitialised memory of the dtype and on the device of `like`; large ones for the CPU with few page faults."""
    size = like.itemsize * math.prod(shape)
    if like.device.type != "cpu" or size < HUGE:
        return like.new_empty(shape)
    return torch.from_numpy(np.empty(size, np.uint8)).view(like.dtype).view(shape)
