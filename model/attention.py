# SPDX-License-Identifier: GPL-3.0-or-later
"""Attention: exact window + sink attention, chunked dense attention, and the two layers built on them.

No function here ever holds a score or mask matrix of the whole sequence (spec/network.md 3 and 7).
Heads come first: queries, keys and values are (heads, length, head width).
"""
from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional as F

from .norm import Linear, RMSNorm
from .progress import Progress, joined
from .rope import rotate

QUERY_BLOCK = 256         # sorted queries that share one band of keys
SCORES_IN_CACHE = 6 << 20  # scores of all heads that one matrix product may leave for the next
FLOPS_PER_CALL = 1 << 34      # of a fused call on a CPU: bounds the time between two polls
FLOPS_PER_GPU_CALL = 1 << 41


def attend(q: torch.Tensor, k: torch.Tensor, v: torch.Tensor, bias: torch.Tensor | None = None) -> torch.Tensor:
    """softmax(q k^T / sqrt(width) + bias) v for (..., heads, length, width); bias is 0 or -inf, in the dtype of q."""
    if not _by_matrix_products(q):
        return F.scaled_dot_product_attention(q, k, v, attn_mask=bias)
    scores = torch.matmul(q * q.shape[-1] ** -0.5, k.transpose(-1, -2))
    return torch.matmul((scores if bias is None else scores + bias).softmax(dim=-1), v)


def _by_matrix_products(q: torch.Tensor) -> bool:
    # The fused CPU kernel runs bfloat16 at the speed of float32 on processors without AMX; products of cache-sized
    # blocks are three times as fast there, and as fast with AMX.
    return q.device.type == "cpu" and q.dtype == torch.bfloat16


def dense_attention(q: torch.Tensor, k: torch.Tensor, v: torch.Tensor,
                    progress: Progress | None = None) -> torch.Tensor:
    """Every query sees every key; queries in chunks. (h, Lq, w), (h, Lk, w) twice -> (h, Lq, w)."""
    heads, length = q.shape[:2]
    size, group = _call_size(q, max(k.shape[1], 1))

    def chunk(begin: int) -> torch.Tensor:
        parts, count = [], min(size, length - begin)
        for first in range(0, heads, group):
            if progress is not None:
                progress((begin + count * first / heads) / max(length, 1))
            rows = slice(first, first + group)
            parts.append(attend(q[None, rows, begin:begin + size], k[None, rows], v[None, rows])[0])
        return parts[0] if len(parts) == 1 else torch.cat(parts)

    return joined(map(chunk, range(0, max(length, 1), size)), length, axis=1)


def _call_size(q: torch.Tensor, keys: int) -> tuple[int, int]:
    """Queries and heads that one call takes on."""
    heads, flops = q.shape[0], 4 * keys * q.shape[2]
    if _by_matrix_products(q):
        limit, cost, size = SCORES_IN_CACHE, keys, max(64, SCORES_IN_CACHE // (heads * keys))
    elif q.device.type == "cpu":
        # Fewer queries than 256 are slower, more than 768 gain nothing.
        limit, cost, size = FLOPS_PER_CALL, flops, min(max(FLOPS_PER_CALL // flops, 256), 768)
    else:
        limit, cost, size = FLOPS_PER_GPU_CALL, flops, max(256, FLOPS_PER_GPU_CALL // (heads * flops))
    return size, min(max(limit // (size * cost), 1), heads)


def window_sink_attention(q: torch.Tensor, k: torch.Tensor, v: torch.Tensor, sink: int, half: int,
                          progress: Progress | None = None) -> torch.Tensor:
    """Query i sees key j iff |i - j| <= half or either is one of the first `sink` tokens. (h, L, w) each."""
    length = q.shape[1]
    progress = progress or Progress()
    if length - sink <= half + 1:
        return dense_attention(q, k, v, progress)
    blocks = range(sink, length, QUERY_BLOCK)
    share = sink * length / (sink * length + len(blocks) * QUERY_BLOCK * (sink + QUERY_BLOCK + 2 * half))
    band_progress = progress.part(share, 1.0)
    sink_k, sink_v = k[:, :sink], v[:, :sink]
    biases: dict[tuple[int, int, int], torch.Tensor] = {}  # all interior blocks share one

    def block(begin: int) -> torch.Tensor:
        band_progress((begin - sink) / (length - sink))
        end, low = min(begin + QUERY_BLOCK, length), max(begin - half, sink)
        high = min(end + half, length)
        place = (begin - low, end - low, high - low)
        if place not in biases:
            biases[place] = F.pad(band_bias(*place, half, q), (sink, 0))
        keys = torch.cat([sink_k, k[:, low:high]], dim=1)
        values = torch.cat([sink_v, v[:, low:high]], dim=1)
        return attend(q[None, :, begin:end], keys[None], values[None], biases[place])[0]

    def parts():
        if sink:
            yield dense_attention(q[:, :sink], k, v, progress.part(0.0, share))
        yield from map(block, blocks)

    return joined(parts(), length, axis=1)


def band_bias(begin: int, end: int, keys: int, half: int, like: torch.Tensor) -> torch.Tensor:
    """(end - begin, keys): 0 where query begin + i and key j are at most `half` apart, else -inf."""
    query = torch.arange(begin, end, device=like.device)[:, None]
    distance = (query - torch.arange(keys, device=like.device)).abs()
    return torch.zeros(distance.shape, dtype=like.dtype, device=like.device).masked_fill_(distance > half, -torch.inf)


class SelfAttention(nn.Module):
    """Projections and QK-norm of self-attention; QK-norm runs over all heads together, before they are split."""

    def __init__(self, width: int, heads: int):
        super().__init__()
        self.heads = heads
        self.in_proj = Linear(width, 3 * width, bias=False)
        self.out_proj = Linear(width, width, bias=False)
        self.q_norm = RMSNorm(width)
        self.k_norm = RMSNorm(width)

    def project(self, x: torch.Tensor, rotation=None) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """(..., D) -> queries, keys, values, each (..., heads, head width); `rotation` = RotaryEmbedding's result."""
        q, k, v = self.in_proj(x).chunk(3, dim=-1)
        return (split_heads(self.q_norm(q), self.heads, v.dtype, rotation),
                split_heads(self.k_norm(k), self.heads, v.dtype, rotation),
                v.unflatten(-1, (self.heads, -1)))


class CrossAttention(nn.Module):
    """Projections and QK-norm of cross-attention."""

    def __init__(self, width: int, heads: int):
        super().__init__()
        self.heads = heads
        self.q_proj = Linear(width, width, bias=False)
        self.k_proj = Linear(width, width, bias=False)
        self.v_proj = Linear(width, width, bias=False)
        self.out_proj = Linear(width, width, bias=False)
        self.q_norm = RMSNorm(width)
        self.k_norm = RMSNorm(width)

    def queries(self, x: torch.Tensor, rotation) -> torch.Tensor:
        """(..., D) -> (..., heads, head width)."""
        q = self.q_proj(x)
        return split_heads(self.q_norm(q), self.heads, q.dtype, rotation)

    def keys_values(self, context: torch.Tensor, rotation) -> tuple[torch.Tensor, torch.Tensor]:
        """(L, D) normalised context -> keys and values, each (L, heads, head width)."""
        v = self.v_proj(context)
        k = split_heads(self.k_norm(self.k_proj(context)), self.heads, v.dtype, rotation)
        return k, v.unflatten(-1, (self.heads, -1))


def split_heads(x: torch.Tensor, heads: int, dtype: torch.dtype, rotation=None) -> torch.Tensor:
    """(..., D) float32 -> (..., heads, D / heads) of `dtype`, rotated in float32 first."""
    x = x.unflatten(-1, (heads, -1))
    return (x if rotation is None else rotate(x, *rotation)).to(dtype)
