# SPDX-License-Identifier: GPL-3.0-or-later
"""What smooth surfaces show of pictures that shine: maps of them, blurred as widely as the lobe is there.

As textured area lights of Heitz et al. 2016, "Real-time polygonal-light shading with linearly transformed cosines".
"""
from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ..vectors import dot, length, unit
from .pictures import Picture

LEVELS = 8               # of a map: 128 x 128 texels, then half as many along each side
SIDE = 1 << (LEVELS - 1)
SHARP, WIDE = 0.5, 1.5   # width of what a lobe shows, in cells, up to which the map shows it, and from which these do
TURNS = -0.8, -0.4, 0.0, 0.4, 0.8  # of facets up and down, in alpha, which turn what they mirror most
LEAST_COSINE = 0.02      # between a mirrored ray and the plane of a picture


class PictureMaps:
    """K pictures, whose cells are K successive runs of emitters."""

    def __init__(self, pictures: tuple[Picture, ...], cells: int, device: torch.device | str):
        self.cells = cells  # of each
        frames, maps = zip(*(_frame_and_maps(picture) for picture in pictures), strict=True)
        to_tensor = lambda x: torch.as_tensor(np.float32(x), device=device)  # noqa: E731
        self._origin, self._axes, self._normal = map(to_tensor, map(np.stack, zip(*frames, strict=True)))
        self._maps = to_tensor(np.stack(maps))  # (K, texels of all levels, 3)
        self._size = (self._axes.norm(dim=-1) ** -1).prod(1).sqrt()  # (K,) of a side
        self._cell = self._size / cells ** 0.5

    def shown(self, x: Tensor, n: Tensor, v: Tensor, roughness: Tensor, turn2: Tensor) -> tuple[Tensor, Tensor]:
        """(P, K, 3) radiance that lobes at points (P, 3) show of pictures, and (P, K) how much maps show it.

        n, v: (P, 3), unit normals and vectors to the viewer; roughness (P,); turn2 (P,): squared angle within pixels.
        """
        slant = unit(v - dot(n, v)[:, None] * n)
        alpha = roughness.square()[:, None]
        shown = [self._along(x, unit(n + turn * alpha * slant), v, roughness, turn2) for turn in TURNS]
        radiance, share = zip(*shown, strict=True)
        weights = torch.stack(share)[..., None].clamp_min(1e-6)  # rays beside a picture show less of it
        return (torch.stack(radiance) * weights).sum(0) / weights.sum(0), share[len(TURNS) // 2]

    def _along(self, x: Tensor, n: Tensor, v: Tensor, roughness: Tensor, turn2: Tensor) -> tuple[Tensor, Tensor]:
        """The same of facets with the normals n (P, 3) and those beside them."""
        n_v = dot(n, v)[:, None]
        ray = 2 * n_v * n - v
        towards = self._origin - x[:, None]
        cosine = (ray[:, None] * self._normal).sum(-1)
        distance = (towards * self._normal).sum(-1) / cosine.where(cosine.abs() > LEAST_COSINE, torch.ones_like(cosine))
        is_ahead = (cosine.abs() > LEAST_COSINE) & (distance > 0)
        place = ray[:, None] * distance[..., None] - towards
        uv = torch.einsum("pkc,kac->pka", place, self._axes).clamp(0, 1)
        steps = self._axes / self._axes.square().sum(-1, keepdim=True)
        beside = length(torch.einsum("pka,kac->pkc", uv, steps) - place)
        lobe2, reach = (2 * roughness.square()).square(), distance.clamp_min(0)
        # At a slant facets that turn aside turn what they mirror less than those that turn up and down: TURNS.
        width, across = ((angle2 + turn2).sqrt()[:, None] * reach for angle2 in (lobe2, lobe2 * n_v[:, 0].square()))
        share = ((WIDE - width / self._cell) / (WIDE - SHARP)).clamp(0, 1) * is_ahead
        share = share * (1 - (beside / (2 * width + self._cell)).clamp(0, 1))
        level = (across / self._size * SIDE).clamp_min(1).log2().clamp(max=LEVELS - 1)
        return self._read(uv, level), share

    def _read(self, uv: Tensor, level: Tensor) -> Tensor:
        """(P, K, 3) between texels and between levels."""
        lower = level.floor()
        fine, coarse = (self._read_level(uv, some.long().clamp(max=LEVELS - 1)) for some in (lower, lower + 1))
        return torch.lerp(fine, coarse, (level - lower)[..., None])

    def _read_level(self, uv: Tensor, level: Tensor) -> Tensor:
        side = (SIDE >> level)[..., None]
        place = (uv * side - 0.5).clamp_min(0).minimum(side - 1)
        low = place.floor()
        share, low = place - low, low.long()
        high = (low + 1).minimum(side - 1)
        begin = (4 * SIDE ** 2 - side[..., 0].square() * 4) // 3
        picture = torch.arange(len(self._maps), device=uv.device)
        rows = [torch.lerp(*(self._maps[picture, begin + y * side[..., 0] + x[..., 0]] for x in (low, high)),
                           share[..., :1]) for y in (low[..., 1], high[..., 1])]
        return torch.lerp(*rows, share[..., 1:])


def _frame_and_maps(picture: Picture) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray], np.ndarray]:
    """Origin (3,), axes (2, 3) whose products with places from there are 0 to 1 in the picture, normal (3,); map."""
    outline = picture.outline.astype(np.float64)
    edges = np.roll(outline, -1, axis=0) - outline
    side = edges[np.linalg.norm(edges, axis=1).argmax()]
    side /= np.linalg.norm(side)
    normal = np.cross(outline - outline[0], edges).sum(axis=0)
    normal /= np.linalg.norm(normal)
    axes = np.stack([side, np.cross(normal, side)])
    along = outline @ axes.T
    low, size = along.min(axis=0), np.ptp(along, axis=0)
    origin = outline[0] + (low - along[0]) @ axes
    axes /= size[:, None]
    column, row = ((picture.position - origin) @ axes.T * SIDE).astype(int).clip(0, SIDE - 1).T
    return (origin, axes, normal), _maps(picture, row * SIDE + column)


def _maps(picture: Picture, texel: np.ndarray) -> np.ndarray:
    """(texels of all levels, 3) radiance, the finest level first; texel: (S,) of samples in that."""
    sums = np.stack([np.bincount(texel, x, SIDE ** 2) for x in (*picture.flux.T, picture.area)])
    levels = [sums.reshape(4, SIDE, SIDE)]
    while levels[-1].shape[1] > 1:
        levels.append(levels[-1].reshape(4, levels[-1].shape[1] // 2, 2, -1, 2).sum(axis=(2, 4)))
    filled = [levels[-1][:3] / levels[-1][3]]
    for flux in levels[-2::-1]:  # where no sample is, what is around
        coarser = filled[-1].repeat(2, axis=1).repeat(2, axis=2)
        filled.append(np.where(flux[3] > 0, flux[:3] / np.where(flux[3] > 0, flux[3], 1), coarser))
    return np.concatenate([level.reshape(3, -1).T for level in reversed(filled)])
