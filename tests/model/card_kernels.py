# SPDX-License-Identifier: GPL-3.0-or-later
"""A card's attention kernels, pretended on the CPU: they refuse what those refuse, and return their layouts."""
from __future__ import annotations

import torch

from renderformer_v2.model.network import attention_with_lse, block_attention

aten = torch.ops.aten


class CardKernels:
    """In place of `torch.ops.aten` in attention_with_lse.py; `calls` are names of operators with the bias's shape."""

    def __init__(self):
        self.calls = []

    def _scaled_dot_product_flash_attention(self, q, keys, values, *, scale):
        self.calls.append(("flash", None))
        return (*attend(q, keys, values, None, scale), None, None)

    def _scaled_dot_product_efficient_attention(self, q, keys, values, bias, compute_log_sumexp, *, scale):
        assert compute_log_sumexp
        self.calls.append(("efficient", None if bias is None else tuple(bias.shape)))
        if bias is not None:
            assert bias.shape == (*q.shape[:3], keys.shape[2]) and bias.dtype == q.dtype
            assert all(not stride % 16 for stride in bias.stride()[:-1]) and bias.stride(-1) == 1
        output, lse = attend(q, keys, values, bias, scale)
        padded = lse.new_full((*lse.shape[:2], -(-lse.shape[2] // 32) * 32), torch.inf)
        padded[..., :lse.shape[2]] = lse
        return output, padded, None, None


def attend(q, keys, values, bias, scale):
    """PyTorch's kernel for CPUs, which returns the log-sum-exp too, with the conditions of those for cards."""
    for x in (q, keys, values):
        assert not x.shape[-1] % 8 and x.stride(-1) == 1 and all(not stride % 8 for stride in x.stride()[:-1])
    return aten._scaled_dot_product_flash_attention_for_cpu(q, keys, values, attn_mask=bias, scale=scale)


def pretend(monkeypatch) -> CardKernels:
    """Attention with log-sum-exp, on the CPU, as on a card of which the kernels are right."""
    kernels = CardKernels()
    monkeypatch.setattr(block_attention, "has_kernels", lambda device: True)
    monkeypatch.setattr(attention_with_lse, "operators", lambda: kernels)
    monkeypatch.setattr(attention_with_lse, "is_right", lambda *_: True)
    return kernels
