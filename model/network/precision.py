# SPDX-License-Identifier: GPL-3.0-or-later
"""Store a network's weights in half precision, but for what needs more."""
from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import nn

from ..compute.precision import has_tensor_float_32
from .norm import Float32Conv2d, Linear
from .renderformer import RenderFormer


def in_precision(model: nn.Module, dtype: torch.dtype, but: Iterable[nn.Module] = ()) -> nn.Module:
    """Store the weights of matrix products and convolutions in `dtype`; norms, tokens and last layer stay float32.

    but: parts of the model that stay as they are.
    """
    left = {module for part in but for module in part.modules()}
    for module in set(model.modules()) - left:
        if isinstance(module, (Linear, nn.Conv2d, nn.ConvTranspose2d)) and not isinstance(module, Float32Conv2d):
            module.to(dtype)
    return model


def as_released(network: RenderFormer, dtype: torch.dtype, device: torch.device) -> RenderFormer:
    """In the precision of the authors' `release` profile (docs/network.md 11): stage 2 without its decoder stays in
    float32 where the device has TensorFloat-32, all else is in `dtype`."""
    stage2 = network.view_transformer
    exact = (stage2.ray_map_encoder, stage2.transformer) if has_tensor_float_32(device) else ()
    return in_precision(network, dtype, exact)
