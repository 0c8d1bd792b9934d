# SPDX-License-Identifier: GPL-3.0-or-later
"""What stands between ray bundles and the emitters that light them most: attention to the tokens along the way.

Attention by content alone has to learn where a line through the scene passes; here a token's distance from the line is
a bias of its score, and how fast the score falls with it is learned (docs/architecture.md 4.2).
"""
from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from ..compute.inference import chunked
from ..light.direct.emitter_light import EMITTER, STRONGEST
from ..network.config import ModelConfig
from ..network.layers import Linear, RMSNorm

WIDTH = 32       # of a head
REACHES = 0.1, 0.17, 0.3  # network units over which the scores of each head fall by 1, at first
HEADS = len(REACHES)
CLEARANCE = 0.1  # network units of the line, at both ends, in which what shines and what is lit lie themselves
NOWHERE = 0.3    # network units from every line at which tokens are that are no triangles: nothing is in the way
FARTHEST = 4.0   # network units to which a line to a sun goes
PLACE = 4        # what is known of the tokens that are seen: how far along the line they are, and their offset from it
QUERIES = 128    # ray bundles at a time


class ShadowAttention(nn.Module):
    """(B, R, D) ray tokens, L scene tokens -> (B, R, D) to be added to the ray tokens; zeros before it is trained."""

    def __init__(self, config: ModelConfig):
        super().__init__()
        width = config.view_transformer_latent_dim
        self.ray_norm, self.token_norm = RMSNorm(width), RMSNorm(width)
        self.q_proj = Linear(width + len(EMITTER), HEADS * WIDTH, bias=False)
        self.k_proj = Linear(width, HEADS * WIDTH, bias=False)
        self.v_proj = Linear(width, HEADS * (WIDTH - 3), bias=False)
        self.out_proj = Linear(STRONGEST * HEADS * (WIDTH - 3 + PLACE), width, bias=False)
        nn.init.zeros_(self.out_proj.weight)
        self.log_reach = nn.Parameter(torch.tensor([math.log(reach) for reach in REACHES]))

    def forward(self, rays: Tensor, position: Tensor, emitters: Tensor, tokens: Tensor, places: Tensor,
                is_triangle: Tensor, is_token: Tensor | None = None) -> Tensor:
        """position (B, R, 3), emitters (B, R, STRONGEST, len(EMITTER)) of the bundles; tokens (B, L, D) at places
        (B, L, 3), is_triangle (B, L); is_token (B, L): not padding, all by default."""
        tokens = self.token_norm(tokens)
        k = self.k_proj(tokens).unflatten(-1, (HEADS, -1)).transpose(1, 2)
        v = self.v_proj(tokens).unflatten(-1, (HEADS, -1)).transpose(1, 2)
        v = torch.cat([v, places[:, None].expand(-1, HEADS, -1, -1).to(v.dtype)], -1)

        def gather(rays: Tensor, position: Tensor, emitters: Tensor) -> Tensor:
            """Some bundles, R first."""
            rays, position, emitters = (x.transpose(0, 1) for x in (rays, position, emitters))
            rays = self.ray_norm(rays)[:, :, None].expand(-1, -1, STRONGEST, -1)
            q = self.q_proj(torch.cat([rays, emitters], -1)).unflatten(-1, (HEADS, -1))
            origin = position[:, :, None].expand(-1, -1, STRONGEST, -1).flatten(1, 2)
            toward, length = line_to(emitters.flatten(1, 2))
            distance2 = squared_distance(origin, toward, length, places)
            distance2 = torch.where(is_triangle[:, None], distance2, NOWHERE ** 2)
            bias = -distance2[:, None] * (-2 * self.log_reach.float()).exp()[:, None, None]
            if is_token is not None:
                bias = bias.masked_fill(~is_token[:, None, None], -torch.inf)
            seen = F.scaled_dot_product_attention(q.flatten(1, 2).transpose(1, 2), k, v, attn_mask=bias.to(q.dtype))
            content, place = seen.transpose(1, 2).float().split([WIDTH - 3, 3], -1)
            offset = place - origin[:, :, None]
            along = (offset * toward[:, :, None]).sum(-1, keepdim=True)
            joined = torch.cat([content, along, offset - along * toward[:, :, None]], -1).flatten(2)
            return self.out_proj(joined.unflatten(1, (-1, STRONGEST)).flatten(2)).float().transpose(0, 1)

        inputs = (x.transpose(0, 1) for x in (rays, position, emitters))
        return chunked(gather, *inputs, size=QUERIES).transpose(0, 1)


def bundle_emitters(emitters: Tensor, patch: int) -> Tensor:
    """(V, STRONGEST, len(EMITTER), H, W) of pixels -> (V, R, STRONGEST, len(EMITTER)), the means of ray bundles."""
    pooled = F.avg_pool2d(emitters.flatten(1, 2), patch).unflatten(1, emitters.shape[1:3]).flatten(3)
    lit = emitters[:, :, EMITTER["toward"]].square().sum(2)
    return (pooled / F.avg_pool2d(lit, patch).flatten(2)[:, :, None].clamp_min(1e-3)).permute(0, 3, 1, 2)


def line_to(emitters: Tensor) -> tuple[Tensor, Tensor]:
    """Unit directions (..., 3) and lengths (...) of the lines to (..., len(EMITTER)) emitters."""
    nearness = emitters[..., EMITTER["nearness"]][..., 0]
    return F.normalize(emitters[..., EMITTER["toward"]], dim=-1), (1 / nearness.clamp_min(1e-3) - 1).clamp(0, FARTHEST)


def squared_distance(origin: Tensor, toward: Tensor, length: Tensor, places: Tensor) -> Tensor:
    """(B, Q, L) f32 of places (B, L, 3) from lines that begin at (B, Q, 3) and go (B, Q) far along unit vectors."""
    with torch.autocast(places.device.type, enabled=False):
        along = toward @ places.transpose(1, 2) - (toward * origin).sum(-1, keepdim=True)
        distance2 = torch.cdist(origin, places).square()
    nearest = torch.minimum(along.clamp_min(CLEARANCE), (length - CLEARANCE).clamp_min(CLEARANCE)[..., None])
    return (distance2 - 2 * nearest * along + nearest.square()).clamp_min(0)
