# SPDX-License-Identifier: GPL-3.0-or-later
"""Uninitialised memory for large results: what is new to a process costs as much time as an attention."""
from __future__ import annotations

import math

import numpy as np
import torch

HUGE = 1 << 22  # bytes: numpy asks the system for huge pages from here on


def like(piece: torch.Tensor, length: int, axis: int) -> torch.Tensor:
    """Room for `length` rows of what `piece` holds some of."""
    return room((*piece.shape[:axis], length, *piece.shape[axis + 1:]), piece)


def room(shape: tuple[int, ...], like: torch.Tensor) -> torch.Tensor:
    """Uninitialised memory of the dtype and on the device of `like`; large ones for the CPU with few page faults."""
    size = like.itemsize * math.prod(shape)
    if like.device.type != "cpu" or size < HUGE:
        return like.new_empty(shape)
    return torch.from_numpy(np.empty(size, np.uint8)).view(like.dtype).view(shape)
