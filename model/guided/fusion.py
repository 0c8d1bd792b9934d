# SPDX-License-Identifier: GPL-3.0-or-later
"""Whom to believe where: ray bundles attend to each other, and say how far each trusts an estimate of its light.

A pixel cannot tell noise from texture, nor a shadow that is there from one that only the estimate has; what lies around
it can (docs/architecture.md 4.2).
"""
from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from ..compute.inference import chunked
from ..network.layers import Linear, RMSNorm, SwiGLU, nerf_encode, nerf_width
from .bundle_decoder import CELLS
from .encoders import Standardization

WIDTH, HEADS, LAYERS = 96, 4, 3
OCTAVES = 4           # of positions
STEEPEST_LOG = 4.0    # of factors of squared distances, of the head that sees the least far, at first


class Fusion(nn.Module):
    """(V, R, S) statistics of ray bundles at (V, R, 3) -> (V, 1, CELLS Hg, CELLS Wg) f32; zeros at first."""

    def __init__(self, statistics: int):
        super().__init__()
        self.standardize = Standardization(statistics)
        self.embed = Linear(statistics + nerf_width(3, OCTAVES), WIDTH)
        self.layers = nn.ModuleList(FusionLayer() for _ in range(LAYERS))
        self.norm = RMSNorm(WIDTH)
        self.project = Linear(WIDTH, CELLS ** 2)
        for p in self.project.parameters():
            nn.init.zeros_(p)

    def forward(self, statistics: Tensor, positions: Tensor, grid: tuple[int, int]) -> Tensor:
        known = torch.cat([self.standardize(statistics), nerf_encode(positions, OCTAVES)], -1)
        x = self.embed(known).float()
        for layer in self.layers:
            x = layer(x, positions)
        said = self.project(self.norm(x)).float().unflatten(1, grid)
        return F.pixel_shuffle(said.movedim(-1, 1), CELLS)


class FusionLayer(nn.Module):
    """Attention of bundles to each other, the less the farther they are apart, and a feed-forward layer; pre-norm."""

    def __init__(self):
        super().__init__()
        self.attention_norm, self.ffn_norm = RMSNorm(WIDTH), RMSNorm(WIDTH)
        self.in_proj, self.out_proj = Linear(WIDTH, 3 * WIDTH, bias=False), Linear(WIDTH, WIDTH, bias=False)
        self.log_slope = nn.Parameter(torch.tensor([STEEPEST_LOG * head / (HEADS - 1) for head in range(HEADS)]))
        self.ffn = SwiGLU(WIDTH, WIDTH)

    def forward(self, x: Tensor, positions: Tensor) -> Tensor:
        """(V, R, WIDTH) f32 -> the same."""
        q, k, v = (part.unflatten(-1, (HEADS, -1)).transpose(1, 2)
                   for part in self.in_proj(self.attention_norm(x)).chunk(3, -1))
        slope = self.log_slope.float().exp()[:, None, None]

        def attend(position: Tensor, query: Tensor) -> Tensor:
            """Some bundles, R first."""
            distance2 = torch.cdist(position.transpose(0, 1), positions).square()[:, None]
            heads = F.scaled_dot_product_attention(query.movedim(0, 2), k, v, (-slope * distance2).to(k.dtype))
            return self.out_proj(heads.permute(2, 0, 1, 3).flatten(2))

        x = x + chunked(attend, positions.transpose(0, 1), q.movedim(2, 0)).transpose(0, 1)
        return x + self.ffn(self.ffn_norm(x))
