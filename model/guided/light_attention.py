# SPDX-License-Identifier: GPL-3.0-or-later
"""Ray bundles attend to the triangles whose light reaches them, and to those that stand between them and emitters.

Attention by content alone would have to learn the geometry of light from scenes. Here geometry is the bias of a score,
and content can only change it (docs/architecture.md 4.2): form factors for the light that surfaces send on, and the
distance of a triangle from the segment to an emitter for its shadow. No ray is traced, and of surfaces one behind the
other all count: to know better is what the layers after this one learn.

Shapes: B scenes, Q ray bundles, S = STRONGEST emitters of each, L tokens, f32, in contracted space.
"""
from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from ..compute.inference import chunked
from ..light.direct.emitter_light import EMITTER, STRONGEST
from ..network.config import ModelConfig
from ..network.layers import Linear, RMSNorm
from .features import SURFACE, GuidedView
from .guided_inputs import GuidedInputs

GATHERING = 2       # heads that gather light
REACHES = 0.02, 0.1  # network units from a segment over which the score of heads for shadows falls by 1, at first
WIDTH = 32          # of queries and keys
CONTENT = 16        # of values
CLEARANCE = 0.03    # network units of a segment, at both ends, in which what shines and what is lit lie themselves
END = 0.01          # network units beyond what is left of it at which a score has fallen by 1
FARTHEST = 4.0      # network units to which the segment to a sun goes
LEAST_FORM_FACTOR = 1e-6
LEAST_OPENNESS = 0.02
PAIRS = 1 << 18     # of ray bundles and triangles at a time: numbers of all steps stay in the processor's cache


class Bundles(NamedTuple):
    """What is known of ray bundles."""

    tokens: Tensor    # (B, Q, D)
    position: Tensor  # (B, Q, 3)
    normal: Tensor    # (B, Q, 3) unit vectors, 0 where nothing is hit
    emitters: Tensor  # (B, Q, S, len(EMITTER))
    exposure: Tensor  # (B, Q, 1)


class Surfaces(NamedTuple):
    """The triangles of scenes that do not shine."""

    tokens: Tensor   # (B, L, D) after stage 1
    corners: Tensor  # (B, L, 3, 3)
    sent: Tensor     # (B, L, 2, 3) radiance that their fronts and backs send on of direct light
    exists: Tensor | None = None  # (B, L) bool: not another kind of token; all by default

    @classmethod
    def of(cls, tokens: Tensor, triangle: Tensor, inputs: GuidedInputs) -> Surfaces:
        """triangle: (B, L) i64, the row of `inputs` that a token stands for, or -1."""
        row = triangle.clamp_min(0)
        exists = (triangle >= 0) & ~inputs.is_light[row]
        return cls(tokens, inputs.triangles[row] * exists[..., None, None], inputs.sent[row], exists)

    @classmethod
    def of_scene(cls, tokens: Tensor, triangle: Tensor, inputs: GuidedInputs) -> Surfaces:
        """The same of one scene, without what does not exist; tokens (L, D), triangle (L,)."""
        everything = cls.of(tokens[None], triangle[None], inputs)
        exists = everything.exists[0]
        return cls(*(x[:, exists] for x in everything[:3]))


def bundles_of(tokens: Tensor, view: GuidedView, scenes: int, patch: int) -> Bundles:
    """(V, R, D) tokens of views, the same number of them for each scene."""
    normal = F.avg_pool2d(view.surface[:, SURFACE["normal"]], patch).flatten(2).transpose(1, 2)
    exposure = view.exposure.view(-1, 1, 1).expand(-1, tokens.shape[1], 1)
    emitters = bundle_emitters(view.emitters, patch)
    return Bundles(*(x.unflatten(0, (scenes, -1)).flatten(1, 2) for x in (
        tokens, view.positions, F.normalize(normal, dim=-1, eps=1e-3), emitters, exposure)))


def bundle_emitters(emitters: Tensor, patch: int) -> Tensor:
    """(V, S, len(EMITTER), H, W) of pixels -> (V, R, S, len(EMITTER)), the means of ray bundles."""
    pooled = F.avg_pool2d(emitters.flatten(1, 2), patch).unflatten(1, emitters.shape[1:3]).flatten(3)
    lit = emitters[:, :, EMITTER["toward"]].square().sum(2)
    return (pooled / F.avg_pool2d(lit, patch).flatten(2)[:, :, None].clamp_min(1e-3)).permute(0, 3, 1, 2)


class LightAttention(nn.Module):
    """(B, Q, D) to be added to the tokens of ray bundles, from bundles and surfaces."""

    def __init__(self, config: ModelConfig):
        super().__init__()
        width = config.view_transformer_latent_dim
        self.ray_norm, self.token_norm = RMSNorm(width), RMSNorm(width)
        self.gathering, self.shadows = GatheringHeads(width), ShadowHeads(width)
        self.out_proj = Linear(self.gathering.features + self.shadows.features, width)

    def forward(self, bundles: Bundles, surfaces: Surfaces) -> Tensor:
        surfaces = surfaces._replace(tokens=self.token_norm(surfaces.tokens))
        heads = [(head, head.keys(surfaces)) for head in (self.gathering, self.shadows)]

        def attend(*some: Tensor) -> Tensor:
            """Some bundles, Q first."""
            some = Bundles(*(x.transpose(0, 1) for x in some))
            some = some._replace(tokens=self.ray_norm(some.tokens))
            found = [head(some, surfaces, *keys) for head, keys in heads]
            return self.out_proj(torch.cat(found, -1)).float().transpose(0, 1)

        size = max(PAIRS // max(surfaces.corners.shape[1], 1), 1)
        return chunked(attend, *(x.transpose(0, 1) for x in bundles), size=size).transpose(0, 1)


class Heads(nn.Module):
    """Scores of triangles by content, and of nothing at all."""

    def __init__(self, heads: int, query_width: int, width: int):
        super().__init__()
        self.heads = heads
        self.q_proj = Linear(query_width, heads * WIDTH, bias=False)
        self.k_proj = Linear(width, heads * WIDTH, bias=False)
        self.v_proj = Linear(width, heads * CONTENT, bias=False)
        self.nothing = Linear(query_width, heads)
        for p in (self.q_proj.weight, *self.nothing.parameters()):
            nn.init.zeros_(p)

    def keys_values(self, surfaces: Surfaces) -> tuple[Tensor, Tensor]:
        """(B, heads, L, width) each."""
        return tuple(self._split(project(surfaces.tokens)) for project in (self.k_proj, self.v_proj))

    def weights(self, queries: Tensor, keys: Tensor, bias: Tensor, of_nothing: Tensor | float,
                exists: Tensor | None) -> tuple[Tensor, Tensor]:
        """(B, heads, Q, L) of triangles and (B, heads, Q, 1) of nothing, of sum 1; bias and of_nothing likewise."""
        scores = self._split(self.q_proj(queries)) @ keys.transpose(2, 3) / math.sqrt(WIDTH) + bias
        if exists is not None:
            scores = scores.masked_fill(~exists[:, None, None], -torch.inf)
        of_nothing = of_nothing + self.nothing(queries).transpose(1, 2)[..., None]
        weights = torch.cat([scores, of_nothing], -1).softmax(-1)
        return weights[..., :-1], weights[..., -1:]

    def _split(self, x: Tensor) -> Tensor:
        return x.unflatten(-1, (self.heads, -1)).transpose(1, 2).float()


class GatheringHeads(Heads):
    """Scores are form factors, and that of nothing is the rest of the hemisphere: how open it is."""

    def __init__(self, width: int):
        super().__init__(GATHERING, width, width)
        self.sharpness = nn.Parameter(torch.ones(GATHERING))
        self.features = GATHERING * (CONTENT + 8) + 1

    def keys(self, surfaces: Surfaces) -> tuple[Tensor, ...]:
        center, vector = surfaces.corners.mean(2), _area_vectors(surfaces.corners)
        return *self.keys_values(surfaces), center, vector

    def forward(self, bundles: Bundles, surfaces: Surfaces, k: Tensor, v: Tensor, center: Tensor,
                vector: Tensor) -> Tensor:
        position, normal = bundles.position, bundles.normal
        area, to_center = vector.norm(dim=-1)[:, None], center.transpose(1, 2)
        distance2 = torch.cdist(position, center).square().clamp_min(1e-8)
        toward = normal @ to_center - (normal * position).sum(-1, keepdim=True)
        from_behind = (vector * center).sum(-1)[:, None] - position @ vector.transpose(1, 2)
        form_factor = toward.clamp_min(0) * from_behind.abs() / ((math.pi * distance2 + area) * distance2)
        total = form_factor.sum(-1, keepdim=True)
        sharpness = self.sharpness.float()[:, None, None]
        score = (1 - sharpness) * area.clamp_min(LEAST_FORM_FACTOR).log()[:, None]  # parts weigh as much as the whole
        score = score + sharpness * (form_factor + LEAST_FORM_FACTOR).log()[:, None]
        p, open_ = self.weights(bundles.tokens, k, score,
                                sharpness * (1 - total).clamp_min(LEAST_OPENNESS).log()[:, None], surfaces.exists)
        near = p * distance2.rsqrt()[:, None]
        nearness = near.sum(-1, keepdim=True)
        direction = near @ center[:, None] - nearness * position[:, None]
        front, back = surfaces.sent[:, None].unbind(3)
        light = p @ back + (p * (from_behind < 0)[:, None]) @ (front - back)
        light = torch.log10(1 + light * bundles.exposure[:, None])
        found = torch.cat([p @ v, direction, nearness.log1p(), open_, light], -1)
        return torch.cat([found.transpose(1, 2).flatten(2), total.clamp_max(2)], -1)


class ShadowHeads(Heads):
    """Scores fall with the distance of triangles from the segments to emitters; nothing in the way scores like one
    that is a reach away. Many small triangles weigh as much as the large one that they make up."""

    def __init__(self, width: int):
        super().__init__(len(REACHES), width + len(EMITTER), width)
        self.log_reach = nn.Parameter(torch.tensor([math.log(reach) for reach in REACHES]))
        self.features = STRONGEST * len(REACHES) * (CONTENT + 2)

    def keys(self, surfaces: Surfaces) -> tuple[Tensor, ...]:
        """The lines through edges in Pluecker coordinates, times how high the triangle is above each; its plane."""
        a, b, c = surfaces.corners.unbind(2)
        vector = 2 * _area_vectors(surfaces.corners)
        edges = torch.stack([torch.cat([torch.linalg.cross(u, v), v - u], -1) for u, v in ((b, c), (c, a), (a, b))])
        length = edges[..., 3:].norm(dim=-1, keepdim=True).clamp_min(1e-6)
        edges = edges * vector.norm(dim=-1, keepdim=True) / length
        return *self.keys_values(surfaces), edges, vector, (vector * a).sum(-1)

    def forward(self, bundles: Bundles, surfaces: Surfaces, k: Tensor, v: Tensor, edges: Tensor, vector: Tensor,
                offset: Tensor) -> Tensor:
        direction, length = line_to(bundles.emitters.flatten(1, 2))
        origin = bundles.position.repeat_interleave(STRONGEST, 1)
        line = torch.cat([direction, torch.linalg.cross(origin, direction)], -1)
        across = direction @ vector.transpose(1, 2)
        across = 1 / torch.where(across.abs() < 1e-9, 1e-9, across)
        inside = ((line @ edges.transpose(2, 3)) * across).amin(0)
        along = (offset[:, None] - origin @ vector.transpose(1, 2)) * across
        beyond = (along - length[..., None] + CLEARANCE).clamp(0, 2) + (CLEARANCE - along).clamp(0, 2)
        distance2 = inside.clamp(-2, 0).square()
        queries = torch.cat([bundles.tokens.repeat_interleave(STRONGEST, 1), bundles.emitters.flatten(1, 2)], -1)
        per_reach2 = (-2 * self.log_reach.float()).exp()[:, None, None]
        area = (vector.norm(dim=-1)[:, None, None] * per_reach2 / (2 * math.pi)).clamp(LEAST_FORM_FACTOR, 1)
        score = area.log() - distance2[:, None] * per_reach2 - (beyond / END).square()[:, None]
        p, free = self.weights(queries, k, score, -1.0, surfaces.exists)
        where = (p * along.clamp(0, FARTHEST)[:, None]).sum(-1, keepdim=True)
        found = torch.cat([p @ v, where, free], -1).transpose(1, 2).flatten(2)
        return found.unflatten(1, (-1, STRONGEST)).flatten(2)


def line_to(emitters: Tensor) -> tuple[Tensor, Tensor]:
    """Unit directions (..., 3) and lengths (...) of the segments to (..., len(EMITTER)) emitters."""
    nearness = emitters[..., EMITTER["nearness"]][..., 0]
    direction = F.normalize(emitters[..., EMITTER["toward"]], dim=-1)
    return direction, (1 / nearness.clamp_min(1e-3) - 1).clamp(0, FARTHEST)


def _area_vectors(corners: Tensor) -> Tensor:
    """(..., 3, 3) -> (..., 3)."""
    a, b, c = corners.unbind(-2)
    return torch.linalg.cross(b - a, c - a) / 2
