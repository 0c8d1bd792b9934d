# SPDX-License-Identifier: GPL-3.0-or-later
"""The packed token sequence: registers, environment, summaries, lights, and geometry in the order of a 16-bit Hilbert
curve (docs/network.md 5).
"""
from __future__ import annotations

from dataclasses import dataclass

import torch

from ..compute.devices import run_operator

BITS = 16  # of an axis of the Hilbert curve; the order depends on it


@dataclass
class Tokens:
    """n tokens and where they are; `triangle` is the triangle's input row, -1 for everything else."""

    embedding: torch.Tensor  # (n, D) float32
    position: torch.Tensor   # (n, 3) float32
    triangle: torch.Tensor   # (n,) int64

    def __len__(self) -> int:
        return len(self.embedding)

    def __getitem__(self, rows) -> Tokens:
        return Tokens(self.embedding[rows], self.position[rows], self.triangle[rows])

    @classmethod
    def at(cls, embedding: torch.Tensor, position: torch.Tensor) -> Tokens:
        """Tokens that are no triangles; `position` is (n, 3), or (3,) for all."""
        return cls(embedding, position.expand(len(embedding), 3),
                   torch.full((len(embedding),), -1, dtype=torch.long, device=embedding.device))

    @classmethod
    def concatenate(cls, groups: list[Tokens]) -> Tokens:
        return cls(torch.cat([g.embedding for g in groups]), torch.cat([g.position for g in groups]),
                   torch.cat([g.triangle for g in groups]))


def centroids(triangles: torch.Tensor) -> torch.Tensor:
    """(N, 3, 3) -> (N, 3); summing the corners in order reproduces the official rounding."""
    return (triangles[:, 0] + triangles[:, 1] + triangles[:, 2]) / 3


def scene_centre(triangles: torch.Tensor) -> torch.Tensor:
    """(3,) position shared by registers and environment tokens, lights included (docs/network.md 5.1)."""
    return (triangles * (1.0 / (len(triangles) + 1e-5))).sum(dim=0).mean(dim=0)


def summarise(ordered: Tokens, block: int, embedding: torch.Tensor) -> Tokens:
    """One token per full run of `block` sorted tokens: mean embedding + learned vector, mean position."""
    count = len(ordered) // block
    full = ordered[:count * block]
    return Tokens.at(full.embedding.unflatten(0, (count, block)).mean(dim=1) + embedding,
                     full.position.unflatten(0, (count, block)).mean(dim=1))


def pack(fixed: list[Tokens], triangles: Tokens, is_light: torch.Tensor, volumes: list[Tokens], block: int,
         summary_embedding: torch.Tensor) -> tuple[Tokens, int]:
    """Sort, summarise, concatenate -> the sequence and the sink's length. `fixed` = registers and environment.

    block: sorted tokens for one summary; 0: no summaries.
    """
    candidates = Tokens.concatenate([triangles, *volumes]) if volumes else triangles
    rows = torch.cat([~is_light, is_light.new_ones(len(candidates) - len(triangles))]).nonzero()[:, 0]
    ordered = candidates[rows[hilbert_order(candidates.position[rows])]]
    summaries = [summarise(ordered, block, summary_embedding)] if block else []
    sink = Tokens.concatenate([*fixed, *summaries, triangles[is_light]])
    return Tokens.concatenate([sink, ordered]), len(sink)


def hilbert_grid(positions: torch.Tensor) -> torch.Tensor:
    """(n, 3) float32 -> (n, 3) int64 cells 0..65535 of the anisotropic bounding box; an axis without extent gives 0."""
    if len(positions) == 0:
        return positions.long()
    low, high = positions.amin(dim=0), positions.amax(dim=0)
    extent = high - low
    scaled = (positions - low) / torch.where(extent > 0, extent, torch.ones_like(extent))
    return (scaled * (2 ** BITS - 1)).long()


def hilbert_codes(grid: torch.Tensor) -> torch.Tensor:
    """(n, 3) int64 cells -> (n,) int64 position along the curve, 48 bits (Skilling's transform)."""
    axes = list(grid.unbind(dim=-1))
    for bit in reversed(range(BITS)):
        below = (1 << bit) - 1
        for i in range(3):
            is_set = (axes[i] >> bit & 1).bool()
            exchange = (axes[0] ^ axes[i]) & below
            axes[i] = torch.where(is_set, axes[i], axes[i] ^ exchange)
            # For i = 0 the exchange is empty, so this line alone decides.
            axes[0] = torch.where(is_set, axes[0] ^ below, axes[0] ^ exchange)
    code = torch.zeros_like(axes[0])
    for bit in reversed(range(BITS)):
        for axis in axes:
            code = code << 1 | (axis >> bit & 1)
    for shift in (1, 2, 4, 8, 16, 32):  # Gray code to binary: prefix XOR
        code = code ^ code >> shift
    return code


def hilbert_order(positions: torch.Tensor) -> torch.Tensor:
    """(n, 3) float32 -> (n,) int64 stable order of the points along the curve."""
    return run_operator("sort", torch.argsort, hilbert_codes(hilbert_grid(positions)), stable=True)
