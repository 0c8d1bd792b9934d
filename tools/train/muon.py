# SPDX-License-Identifier: GPL-3.0-or-later
"""Muon (Jordan et al. 2024), with the steps of `torch.optim.Muon` but all matrices of a shape at once: a small network
has many small ones, whose operations cost a card less than their launching costs the processor."""
from __future__ import annotations

import math
from collections.abc import Iterable

import torch
from torch import Tensor, nn

MOMENTUM = 0.95
COEFFICIENTS = 3.4445, -4.7750, 2.0315  # of the quintic that brings all singular values near 1
ITERATIONS = 5
LEAST_NORM = 1e-7
RMS = 0.2  # of an update relative to the learning rate, about that of AdamW's


class Muon(torch.optim.Optimizer):
    """Updates of matrices whose singular values are all about 1 (Nesterov momentum, decoupled weight decay)."""

    def __init__(self, params: Iterable[nn.Parameter], lr: float, weight_decay: float):
        super().__init__(params, {"lr": lr, "weight_decay": weight_decay})

    @torch.no_grad()
    def step(self) -> None:
        for group in self.param_groups:
            same_shape: dict[torch.Size, list[nn.Parameter]] = {}
            for p in group["params"]:
                if p.grad is not None:
                    same_shape.setdefault(p.shape, []).append(p)
            for shape, params in same_shape.items():
                gradients = [p.grad for p in params]
                momenta = [self.state[p].setdefault("momentum_buffer", torch.zeros_like(p)) for p in params]
                torch._foreach_lerp_(momenta, gradients, 1 - MOMENTUM)
                updates = orthogonalized(torch.stack(torch._foreach_lerp(gradients, momenta, MOMENTUM)))
                torch._foreach_mul_(params, 1 - group["lr"] * group["weight_decay"])
                torch._foreach_add_(params, list(updates.to(params[0].dtype).unbind()),
                                    alpha=-group["lr"] * RMS * math.sqrt(max(shape)))


def orthogonalized(matrices: Tensor) -> Tensor:
    """(n, rows, columns) -> bfloat16 of the same singular vectors, by Newton and Schulz's iteration."""
    x, (a, b, c) = matrices.bfloat16(), COEFFICIENTS
    is_tall = x.shape[1] > x.shape[2]
    x = x.mT if is_tall else x
    x = x / torch.linalg.matrix_norm(x, keepdim=True).clamp_min(LEAST_NORM)
    for _ in range(ITERATIONS):
        gram = x @ x.mT
        x = torch.baddbmm(x, torch.baddbmm(gram, gram, gram, beta=b, alpha=c), x, beta=a)
    return x.mT if is_tall else x
