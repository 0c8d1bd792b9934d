# SPDX-License-Identifier: GPL-3.0-or-later
"""Device and number format, decided by what is there and by a quick measurement."""
from __future__ import annotations

import functools
import time

import torch
from torch import nn

from .network.norm import Float32Conv2d, Linear

PRECISIONS = {"fp32": torch.float32, "bf16": torch.bfloat16, "fp16": torch.float16}


def choose_device(name: str = "auto") -> torch.device:
    """`auto` prefers CUDA, then Apple's MPS, then the CPU. Raises ValueError for a device that is not there."""
    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "mps" if torch.backends.mps.is_available() else "cpu"
    if name == "cuda" and not torch.cuda.is_available():
        raise ValueError("no CUDA device is available to PyTorch: choose the device Automatic or CPU")
    if name == "mps" and not torch.backends.mps.is_available():
        raise ValueError("no Metal (MPS) device is available to PyTorch: choose the device Automatic or CPU")
    return torch.device(name)


def choose_precision(name: str, device: torch.device) -> torch.dtype:
    """`auto` takes bfloat16 where its matrix products are faster than float32's on this very machine."""
    if name != "auto":
        if name == "fp16" and device.type == "cpu":
            raise ValueError("fp16 needs a GPU: choose the precision Automatic, fp32 or bf16")
        return PRECISIONS[name]
    if device.type == "mps":
        return torch.float16
    return torch.bfloat16 if _bfloat16_gains(device) else torch.float32


def in_precision(model: nn.Module, dtype: torch.dtype) -> nn.Module:
    """Store the weights of matrix products and convolutions in `dtype`; norms, tokens and last layer stay float32."""
    for module in model.modules():
        if isinstance(module, (Linear, nn.Conv2d, nn.ConvTranspose2d)) and not isinstance(module, Float32Conv2d):
            module.to(dtype)
    return model


@functools.cache
def _bfloat16_gains(device: torch.device) -> bool:
    seconds = {dtype: _product_seconds(device, dtype) for dtype in (torch.float32, torch.bfloat16)}
    return seconds[torch.bfloat16] < 0.8 * seconds[torch.float32]


def _product_seconds(device: torch.device, dtype: torch.dtype, size: int = 768, repeats: int = 4) -> float:
    a = torch.ones(size, size, dtype=dtype, device=device)
    best = float("inf")
    for _ in range(repeats):
        begin = time.perf_counter()
        (a @ a)[0, 0].item()
        best = min(best, time.perf_counter() - begin)
    return best
