# SPDX-License-Identifier: GPL-3.0-or-later
"""Work on many points in chunks: this bounds memory, keeps data in the processor's cache and lets the user cancel."""
from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from ..compute.inference import current_pieces
from ..compute.threads import shared


def in_chunks(size: int, function: Callable[..., Tensor | tuple[Tensor, ...]], *tensors: Tensor):
    """function(*tensors) of tensors (P, ...), by `size` points at a time on several threads.

    function returns a tensor (P, ...) or a tuple of such tensors; so does this. Chunks are smaller where the memory of
    a card ran out.
    """
    size = current_pieces().limit(size)
    results = shared(function, *(x.split(size) for x in tensors))
    if isinstance(results[0], Tensor):
        return torch.cat(results)
    return tuple(torch.cat(parts) for parts in zip(*results, strict=True))
