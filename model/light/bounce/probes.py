# SPDX-License-Identifier: GPL-3.0-or-later
"""Compute light at some pixels (probes) and interpolate it to all others."""
from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cached_property

import torch
from torch import Tensor
from torch.nn import functional as F

from ...compute.threads import shared
from ..edge_stopping import alike, alike_around, nearness
from ..weighted_rows import weighted_rows

GRID = 2          # pixels between two probes, which stand in the middle of their cells
FINE = 1, 256     # the same in pictures of up to so many pixels
TRUSTED = 0.5     # what probes around must say about a pixel for it to need none of its own
LEAST = 1e-5      # weight that keeps the sum above zero
AT_ONCE = 8192    # probes: what their rays meet stays in a processor's cache
NOISY, NOISELESS = (1, 2), ()  # probes between those of which a probe takes the mean, 5x5 at a time

Light = Callable[..., Tensor]
Way = tuple[Tensor, Tensor]  # numbers of probes around places, row by row, and their weights, (P, K) both


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
        as much in the first three channels counts 1/e, from the second on.
        """
        where = self.picture[2] if where is None else where
        valid = self.of(where).flatten()
        at, lit = self._lit(light, valid, known)
        if not (len(lit) or where.any()):
            return lit.new_zeros(*where.shape[:2], lit.shape[1])
        found = _known(lit.new_zeros(len(valid), lit.shape[1]), at, lit, valid)
        for i, spread in enumerate(spreads):
            found = self._mean_around(found, spread, tolerance if i else None)
        probes = self
        while probes.grid > self.finest:
            found, trust = _interpolated(found, probes._to_closer)
            probes = probes.closer
            valid = probes.of(where).flatten()
            at, lit = probes._lit(light, valid & (trust < TRUSTED), known)
            found = _known(found, at, lit, valid)
        return _interpolated(found, probes._to_pixels)[0].view(*where.shape[:2], -1) * where

    @cached_property
    def closer(self) -> Probes:
        """Twice as many along each axis."""
        return Probes(*self.picture, self.grid // 2, self.finest)

    def of(self, picture: Tensor) -> Tensor:
        """(h, w, C) at all pixels -> at the probes."""
        return picture.index_select(0, self.rows).index_select(1, self.columns)

    def _lit(self, light: Light, valid: Tensor, known: tuple[Tensor, ...]) -> tuple[Tensor, Tensor]:
        """Numbers (P,) of all valid probes (rows columns,), and (P, C) light there."""
        at = valid.nonzero()[:, 0]  # a GPU is waited for here
        known = (*self.places, *map(self.of, known))
        position, normal, *known = (each.flatten(0, 1).index_select(0, at) for each in known)
        given = position, normal, self.number.flatten()[at], *known
        return at, torch.cat(shared(light, *(each.split(AT_ONCE) for each in given)))

    @cached_property
    def _to_closer(self) -> Way:
        return self._way(self.closer.rows, self.closer.columns, self.closer.x, self.closer.n)

    @cached_property
    def _to_pixels(self) -> Way:
        position, normal = self.picture[:2]
        pixels = (torch.arange(side, device=position.device) for side in position.shape[:2])
        return self._way(*pixels, _planes(position), _planes(normal))

    def _way(self, rows: Tensor, columns: Tensor, position: Tensor, normal: Tensor) -> Way:
        """To pixels in such `rows` (h,) and `columns` (w,), with positions and normals (3, h, w): (h w, 4)."""
        there, numbers, weights = torch.cat([self.x, self.n, self.near[None]]).flatten(1), [], []
        for down in (0, 1):
            for right in (0, 1):
                i, y = _neighbour(rows, len(self.rows), self.grid, down)
                j, z = _neighbour(columns, len(self.columns), self.grid, right)
                number = (len(self.columns) * i[:, None] + j).flatten()
                x, n, near = there.index_select(1, number).unflatten(1, normal.shape[1:]).split([3, 3, 1])
                numbers.append(number)
                weights.append((y[:, None] * z * (alike(x - position, n, normal, near[0]) + LEAST)).flatten())
        return torch.stack(numbers, -1), torch.stack(weights, -1)

    def _mean_around(self, found: Tensor, spread: int, tolerance: float | None) -> Tensor:
        """The same of probes, each the mean of 5x5 that stand `spread` apart."""
        if spread not in self._around:
            self._around[spread] = alike_around(self.x, self.n, self.near, spread)
        number, weight = self._around[spread]
        if tolerance is not None:
            other = (found[number] - found[:, None])[..., :3].abs().amax(-1)
            weight = weight * (-(other / tolerance).square()).exp()
        total = weighted_rows(found, number, weight)
        return torch.where(total[:, -1:] > 0, total / total[:, -1:].clamp_min(1e-12), found) * found[:, -1:]


def _known(found: Tensor, at: Tensor, lit: Tensor, valid: Tensor) -> Tensor:
    """(N, C + 1) of what was `found` at N places, (N, C), and is `lit` at some, and 1; 0 where none is `valid`."""
    found = F.pad(found, (0, 1), value=1.0) * valid[:, None]
    found[at, :-1] = lit
    return found


def _interpolated(found: Tensor, way: Way) -> tuple[Tensor, Tensor]:
    """(P, C) at all places of a way of what is `_known` at the probes, and (P,), how much these say, 1 at most."""
    light, trust = weighted_rows(found, *way).split([found.shape[1] - 1, 1], 1)
    return light / trust.clamp(min=LEAST ** 2), trust[:, 0]


def _planes(picture: Tensor) -> Tensor:
    return picture.permute(2, 0, 1).contiguous()


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
