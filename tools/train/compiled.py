# SPDX-License-Identifier: GPL-3.0-or-later
"""torch.compile for what gains by it: chains of small operations, between the products and attentions."""
from __future__ import annotations

from torch import nn

from renderformer_v2.model.network.layers import RMSNorm, SwiGLU

PARTS = SwiGLU, RMSNorm


def compile_parts(model: nn.Module) -> None:
    """Compile at first use, for any number of tokens; the names of the weights stay."""
    for module in model.modules():
        if isinstance(module, PARTS):
            module.compile(dynamic=True)
