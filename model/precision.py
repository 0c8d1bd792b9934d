# SPDX-License-Identifier: GPL-3.0-or-later
"""Choose device and number format by the hardware."""
from __future__ import annotations

from collections.abc import Mapping

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
    """`auto` takes half precision where the device has it, by what it says of itself: always the same on a machine.

    Raises ValueError for one that the device does not have.
    """
    if name != "auto":
        if name == "fp16" and device.type == "cpu":
            raise ValueError("fp16 needs a GPU: choose the precision Automatic, fp32 or bf16")
        return PRECISIONS[name]
    if device.type == "cuda":
        return of_cuda(torch.cuda.get_device_capability(device))
    return torch.float16 if device.type == "mps" else of_processor(torch.cpu.get_capabilities())


def of_processor(capabilities: Mapping) -> torch.dtype:
    """bfloat16 with AVX512-BF16, which processors with AMX have too: twice as fast as float32 and more.

    Others compute it bit by bit, up to 500 times slower. capabilities: as torch.cpu.get_capabilities() gives them.
    """
    return torch.bfloat16 if capabilities.get("avx512_bf16") else torch.float32


def of_cuda(capability: tuple[int, int]) -> torch.dtype:
    """bfloat16 from Ampere on (8.0), float16 on Volta and Turing (7.0): what their matrix units multiply."""
    return torch.bfloat16 if capability >= (8, 0) else torch.float16 if capability >= (7, 0) else torch.float32


def in_precision(model: nn.Module, dtype: torch.dtype) -> nn.Module:
    """Store the weights of matrix products and convolutions in `dtype`; norms, tokens and last layer stay float32."""
    for module in model.modules():
        if isinstance(module, (Linear, nn.Conv2d, nn.ConvTranspose2d)) and not isinstance(module, Float32Conv2d):
            module.to(dtype)
    return model
