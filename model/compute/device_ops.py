# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators that run on the CPU for Apple's GPUs, because PyTorch lacks them there or gets them wrong."""
from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

# By PyTorch's name of an operator, the release from which on the GPU can do it.
SINCE = {
    "_embedding_bag": None,      # of F.embedding_bag
    "grid_sampler_3d": (2, 13),  # of F.grid_sample; with the padding "border", which came after the operator
    "sort": None,                # of int64, which comes out wrong on some systems, without a word
}


def done_on(device: torch.device, name: str, release=torch.__version__) -> torch.device:
    """Where the operator of this name is done for tensors of a device; `release` compares with (major, minor)."""
    lacking = name in SINCE and (SINCE[name] is None or release < SINCE[name])
    return torch.device("cpu") if device.type == "mps" and lacking else device


def done(name: str, function: Callable[..., Tensor], *tensors: Tensor, **options) -> Tensor:
    """function(*tensors, **options), which calls the operator of this name, on the tensors' device."""
    device = tensors[0].device
    return function(*(x.to(done_on(device, name)) for x in tensors), **options).to(device)
