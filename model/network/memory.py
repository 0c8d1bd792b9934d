# SPDX-License-Identifier: GPL-3.0-or-later
"""Progress through nested steps, and loops over chunks that bound memory and poll for cancellation."""
from __future__ import annotations

import math
from typing import Callable, Iterable

import numpy as np
import torch

# Rows per chunk: large enough for the matrix products, small enough that a chunk takes well under 0.2 s and that the
# element-wise work between the products stays in the processor's cache.
CHUNK = 512
GPU_CHUNK = 4096
HUGE = 1 << 22  # bytes: numpy asks the system for huge pages from here on


class Progress:
    """A share [start, end] of a callback `callback(text, fraction)`, which may raise to cancel."""

    def __init__(self, callback: Callable[[str, float], None] | None = None, text: str = "",
                 start: float = 0.0, end: float = 1.0):
        self.callback, self.text, self.start, self.end = callback, text, start, end

    def __call__(self, fraction: float) -> None:
        if self.callback is not None:
            self.callback(self.text, self.start + (self.end - self.start) * fraction)

    def part(self, start: float, end: float, text: str | None = None) -> Progress:
        """The share [start, end] of this share."""
        if self.callback is None:
            return self  # one object for all layers: a compiled layer is then one program
        span = self.end - self.start
        return Progress(self.callback, self.text if text is None else text,
                        self.start + span * start, self.start + span * end)


def cuts(begin: int, end: int, device: torch.device) -> list[tuple[int, int]]:
    """begin..end in pieces that are computed one after the other: a single one where gradients are wanted."""
    size = max(end - begin, 1) if torch.is_grad_enabled() else GPU_CHUNK if device.type == "cuda" else CHUNK
    return [(first, min(first + size, end)) for first in range(begin, end, size)]


def chunked(function, *tensors: torch.Tensor, progress: Progress | None = None, size: int = CHUNK, axis: int = 0,
            into: torch.Tensor | None = None):
    """function(*tensors), computed for `size` rows of the tensors at a time and concatenated along `axis`.

    `function` returns a tensor or a tuple of tensors with as many rows (on that axis) as it was given. into: as for
    `joined`.
    """
    rows = len(tensors[0])
    if torch.is_grad_enabled():
        size = max(rows, 1)  # autograd would hold a gradient of full length for every slice
    results = None if into is None else [into]
    for begin in range(0, max(rows, 1), size):
        if progress is not None:
            progress(begin / max(rows, 1))
        result = function(*(t[begin:begin + size] for t in tensors))
        if size >= rows:
            return result
        parts = result if isinstance(result, tuple) else (result,)
        results = results or [like(part, rows, axis) for part in parts]
        for whole, part in zip(results, parts):
            whole.narrow(axis, begin, part.shape[axis]).copy_(part)
    return tuple(results) if isinstance(result, tuple) else results[0]


def joined(parts: Iterable[torch.Tensor], length: int, axis: int, into: torch.Tensor | None = None) -> torch.Tensor:
    """The concatenation of `parts`, `length` long; without gradients each part is put into place as it comes.

    into: that place, if the parts are made of nothing there but their own rows. Memory that is new to the process costs
    as much time as an attention.
    """
    if torch.is_grad_enabled():
        return torch.cat(list(parts), dim=axis)
    result, begin = into, 0
    for part in parts:
        if part.shape[axis] == length:
            return part
        result = like(part, length, axis) if result is None else result
        result.narrow(axis, begin, part.shape[axis]).copy_(part)
        begin += part.shape[axis]
    return result


def like(part: torch.Tensor, length: int, axis: int) -> torch.Tensor:
    """Room for `length` rows of what `part` holds some of."""
    return room((*part.shape[:axis], length, *part.shape[axis + 1:]), part)


def room(shape: tuple[int, ...], like: torch.Tensor) -> torch.Tensor:
    """Uninitialised memory of the dtype and on the device of `like`; large ones for the CPU with few page faults."""
    size = like.itemsize * math.prod(shape)
    if like.device.type != "cpu" or size < HUGE:
        return like.new_empty(shape)
    return torch.from_numpy(np.empty(size, np.uint8)).view(like.dtype).view(shape)
