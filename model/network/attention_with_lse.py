# SPDX-License-Identifier: GPL-3.0-or-later
"""Attention that also returns the log-sum-exp of its scores, by which attention to two groups of keys is merged.

PyTorch's public function does not return it, but the operators below it do. For inference: no gradient passes through a
log-sum-exp. Queries are (several, heads, n, width), keys and values (several, heads, m, width).
"""
from __future__ import annotations

from collections.abc import Callable
from functools import cache

import torch
from torch.nn import functional as F

SCORES = 1 << 25   # of a matrix where no kernel does without one: 128 MB in float32
WIDTHS = 8         # the kernels take head widths that are multiples of it,
BIASES = 16        # and rows of a bias that begin at multiples of it
AGREEMENT = 0.05   # wrong layouts, bases of logarithms and scales differ by more, bfloat16 by less


def attention_with_lse(q: torch.Tensor, keys: torch.Tensor, values: torch.Tensor,
                       bias: torch.Tensor | None = None) -> tuple[torch.Tensor, torch.Tensor]:
    """softmax(q k^T / sqrt(width) + bias) v, like q, and log(sum(exp(scores))), (several, heads, n) float32.

    bias: 0 or -inf, of q's dtype, that broadcasts to (several, heads, n, m). A query that sees no key gets numbers
    without a meaning.
    """
    kernels = [flash, memory_efficient] if bias is None else [memory_efficient]
    chosen = next((kernel for kernel in kernels if is_right(kernel, q.device, q.dtype, q.shape[-1])), plain)
    return chosen(q, keys, values, bias)


def merged(a: tuple[torch.Tensor, torch.Tensor], b: tuple[torch.Tensor, torch.Tensor]) -> torch.Tensor:
    """Attention to the keys of a and of b together, from output and log-sum-exp of each."""
    share = torch.sigmoid(a[1] - b[1])[..., None]
    return torch.lerp(b[0].float(), a[0].float(), share).to(a[0].dtype)


def has_kernels(device: torch.device) -> bool:
    """Whether the operators may be there: on NVIDIA's cards, and on AMD's, which have the same name."""
    return device.type == "cuda"


@cache
def is_right(kernel: Callable, device: torch.device, dtype: torch.dtype, width: int) -> bool:
    """Whether a kernel runs and gives what `plain` does: cards, formats and builds of PyTorch differ, and private
    operators may change. The host waits for the card, once."""
    q, keys, values = (torch.arange(2 * 3 * n * width, device=device).mul(7).sin().view(2, 3, n, width).to(dtype)
                       for n in (40, 72, 72))
    bias = None if kernel is flash else q.new_zeros(40, 72).masked_fill_(
        torch.arange(72, device=device) > torch.arange(40, device=device)[:, None] + 20, -torch.inf)
    try:
        pairs = zip(kernel(q, keys, values, bias), plain(q, keys, values, bias))
        return all((found.float() - expected.float()).abs().max().item() < AGREEMENT for found, expected in pairs)
    except torch.OutOfMemoryError:
        raise
    except (RuntimeError, TypeError, AttributeError):
        return False


def flash(q: torch.Tensor, keys: torch.Tensor, values: torch.Tensor, bias: None) -> tuple[torch.Tensor, torch.Tensor]:
    """In half precision from Ampere on; it takes no bias."""
    found = operators()._scaled_dot_product_flash_attention(*widened(q, keys, values), scale=q.shape[-1] ** -0.5)
    return narrowed(*found[:2], q)


def memory_efficient(q: torch.Tensor, keys: torch.Tensor, values: torch.Tensor,
                     bias: torch.Tensor | None) -> tuple[torch.Tensor, torch.Tensor]:
    """In all formats, on older cards too."""
    if bias is not None:
        m = keys.shape[2]
        bias = F.pad(bias, (0, -m % BIASES))[..., :m] if m % BIASES else bias
        bias = bias.expand(*q.shape[:3], m)
    found = operators()._scaled_dot_product_efficient_attention(*widened(q, keys, values), bias, True,
                                                                scale=q.shape[-1] ** -0.5)
    return narrowed(*found[:2], q)


def operators():
    """PyTorch's, private ones included."""
    return torch.ops.aten


def widened(*heads: torch.Tensor) -> list[torch.Tensor]:
    """Zeros beyond the head width change no product."""
    missing = -heads[0].shape[-1] % WIDTHS
    return [F.pad(x, (0, missing)) if missing else x for x in heads]


def narrowed(output: torch.Tensor, lse: torch.Tensor, q: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Without what the kernels add to the head width and to the number of queries."""
    return output[..., :q.shape[-1]], lse[..., :q.shape[2]]


def plain(q: torch.Tensor, keys: torch.Tensor, values: torch.Tensor,
          bias: torch.Tensor | None = None) -> tuple[torch.Tensor, torch.Tensor]:
    """By matrix products in float32, on any device; at most `SCORES` scores exist at once, or those of one query."""
    (several, heads, n, width), m = q.shape, keys.shape[2]
    bias = None if bias is None else bias.expand(several, heads, n, m)
    rows = max(min(SCORES // (heads * m), n), 1)
    count = max(SCORES // (heads * rows * m), 1)

    def some(first: int, row: int) -> tuple[torch.Tensor, torch.Tensor]:
        which, queries = slice(first, first + count), slice(row, row + rows)
        scores = torch.matmul(q[which, :, queries].float() * width ** -0.5, keys[which].float().transpose(2, 3))
        if bias is not None:
            scores += bias[which, :, queries]
        lse = scores.logsumexp(dim=-1)
        weights = scores.sub_(lse[..., None]).exp_()
        return torch.matmul(weights, values[which].float()).to(q.dtype), lse

    lines = [[torch.cat(x, dim=2) for x in zip(*(some(first, row) for row in range(0, n, rows)))]
             for first in range(0, several, count)]
    return tuple(torch.cat(x) for x in zip(*lines))
