# SPDX-License-Identifier: GPL-3.0-or-later
"""Compute light at some pixels (probes) and interpolate it to all others."""
from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cached_property

import torch
from torch import Tensor

from .likeness import alike, alike_around, around, nearness

GRID = 2          # pixels between two probes, which stand in the middle of their cells
FINE = 1, 256     # the same in pictures of up to so many pixels
TRUSTED = 0.5     # what probes around must say about a pixel for it to need none of its own
LEAST = 1e-5      # weight that keeps the sum above zero
NOISY, NOISELESS = (1, 2), ()  # probes between those of which a probe takes the mean, 5x5 at a time

Light = Callable[..., Tensor]
Way = list[tuple[Tensor, Tensor, Tensor]]  # rows and columns of the probes around pixels, and weights (h, w) of these


def grid_of(picture_size: int) -> int:
    """Pixels between two probes of a picture with this longer side."""
    grid, most = FINE
    return grid if picture_size <= most else GRID


class Probes:
    """Every `grid`-th pixel of a picture, at which light is found for all of it.

    Each pixel takes the mean of the four nearest probes, weighted by how far they are off its plane and turned away.
    Where the probes around say little, there are more of them, down to every `finest` pixel. The weights are found
    once for all kinds of light.
    """

    def __init__(self, position: Tensor, normal: Tensor, covered: Tensor, grid: int = GRID, finest: int = GRID):
        """position, normal: (h, w, 3); covered: (h, w, 1) bool, where they are any."""
        self.picture, self.grid, self.finest = (position, normal, covered), grid, finest
        self.rows, self.columns = (
            torch.arange(min(grid // 2, side - 1), side, grid, device=position.device) for side in position.shape[:2])
        self.number = _z_order(len(self.rows), len(self.columns), position.device)
        self.places = self.of(position), self.of(normal)
        self.x, self.n = map(_planes, self.places)
        self.near = nearness(self.x, self.of(covered)[..., 0])
        self._around = {}

    def gathered(self, light: Light, *known: Tensor, where: Tensor | None = None, spreads: Iterable[int] = NOISELESS,
                 tolerance: float | None = None) -> Tensor:
        """(h, w, C) of a `light` that knows (P, C) at points and normals (P, 3) of probes (P,) by number.

        known: (h, w, ...), what else is to be told of the probes. where: (h, w, 1) bool, the pixels that need light,
        all that are covered by default; it is 0 elsewhere.
        With `spreads` probes are made means of those around before, weighted alike. With a `tolerance` what differs by
        as much counts 1/e, from the second on.
        """
        where = self.picture[2] if where is None else where
        valid = self.of(where)[..., 0]
        at, lit = self._lit(light, valid, known)
        found = lit.new_zeros(lit.shape[1], *valid.shape)
        if not len(lit):
            return found.new_zeros(*where.shape[:2], len(found))
        found[:, *at] = lit.T
        for i, spread in enumerate(spreads):
            found = self._mean_around(found, valid, spread, tolerance if i else None)
        probes = self
        while probes.grid > self.finest:
            found, trust = probes._interpolated(found, valid, probes._to_closer)
            probes = probes.closer
            valid = probes.of(where)[..., 0]
            at, lit = probes._lit(light, valid & (trust < TRUSTED), known)
            found[:, *at] = lit.T
        return probes._interpolated(found, valid, probes._to_pixels)[0].permute(1, 2, 0) * where

    @cached_property
    def closer(self) -> Probes:
        """Twice as many along each axis."""
        return Probes(*self.picture, self.grid // 2, self.finest)

    def of(self, picture: Tensor) -> Tensor:
        """(h, w, C) at all pixels -> at the probes."""
        return picture.index_select(0, self.rows).index_select(1, self.columns)

    def _lit(self, light: Light, valid: Tensor, known: tuple[Tensor, ...]) -> tuple[tuple[Tensor, Tensor], Tensor]:
        """Rows and columns (P,) of all valid probes, and (P, C) light there."""
        at = valid.nonzero().unbind(1)  # a GPU is waited for here
        position, normal, *known = (each[at] for each in (*self.places, *map(self.of, known)))
        return at, light(position, normal, self.number[at], *known)

    @cached_property
    def _to_closer(self) -> Way:
        return self._way(self.closer.rows, self.closer.columns, self.closer.x, self.closer.n)

    @cached_property
    def _to_pixels(self) -> Way:
        position, normal = self.picture[:2]
        pixels = (torch.arange(side, device=position.device) for side in position.shape[:2])
        return self._way(*pixels, _planes(position), _planes(normal))

    def _way(self, rows: Tensor, columns: Tensor, position: Tensor, normal: Tensor) -> Way:
        """To pixels in such `rows` (h,) and `columns` (w,), with positions and normals (3, h, w)."""
        found = []
        for down in (0, 1):
            for right in (0, 1):
                i, y = _neighbour(rows, len(self.rows), self.grid, down)
                j, z = _neighbour(columns, len(self.columns), self.grid, right)
                x, n, near = (_selected(each, i, j) for each in (self.x, self.n, self.near))
                found.append((i, j, y[:, None] * z * (alike(x - position, n, normal, near) + LEAST)))
        return found

    def _interpolated(self, found: Tensor, valid: Tensor, way: Way) -> tuple[Tensor, Tensor]:
        """(C, h, w) at all pixels of a way of what was `found` at the probes, (C, rows, columns).

        And (h, w), how much the valid probes say about them, 1 at most.
        """
        valid = valid.to(found.dtype)
        total = weights = 0.0
        for i, j, weight in way:
            weight = weight * _selected(valid, i, j)
            total, weights = total + weight * _selected(found, i, j), weights + weight
        return total / torch.clamp(weights, min=LEAST ** 2), weights

    def _mean_around(self, found: Tensor, valid: Tensor, spread: int, tolerance: float | None) -> Tensor:
        """(C, rows, columns) of probes, each the mean of 5x5 that stand `spread` apart."""
        if spread not in self._around:
            self._around[spread] = alike_around(self.x, self.n, self.near, spread)
        weight = self._around[spread] * around(valid[None].to(found.dtype), spread)[0]
        there = around(found, spread)
        if tolerance is not None:
            weight = weight * (-((there - found[:, None]).abs().amax(0) / tolerance).square()).exp()
        total, weights = (weight * there).sum(1), weight.sum(0)
        return torch.where(weights > 0, total / weights.clamp_min(1e-12), found)


def _planes(picture: Tensor) -> Tensor:
    return picture.permute(2, 0, 1).contiguous()


def _selected(probes: Tensor, i: Tensor, j: Tensor) -> Tensor:
    """(..., rows, columns) -> (..., h, w) in rows (h,) and columns (w,)."""
    return probes.index_select(-2, i).index_select(-1, j)


def _z_order(rows: int, columns: int, device: torch.device) -> Tensor:
    """(h, w) numbers that follow each other within every square of 2, 4, 8... probes, from 0 again every 64."""
    down, right = (sum(((i >> bit) & 1) << (2 * bit) for bit in range(6))
                   for i in (torch.arange(count, device=device) for count in (rows, columns)))
    return 2 * down[:, None] + right[None]


def _neighbour(pixels: Tensor, count: int, grid: int, further: int) -> tuple[Tensor, Tensor]:
    """Index of the probe before or behind each pixel along an axis, and its linear weight."""
    at = ((pixels - grid // 2) / grid).clamp(0, count - 1)
    low = at.floor().long().clamp(max=max(count - 2, 0))
    share = at - low
    return (low + further).clamp(max=count - 1), share if further else 1 - share
