# SPDX-License-Identifier: GPL-3.0-or-later
"""Compute light at some pixels, the probes, and interpolate it to all others."""
from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cached_property
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional as F

from ..compute.inference import current_pieces
from ..compute.threads import shared
from .edge_stopping import DIFFUSE, GLOSSY, edge_weights, neighbour_weights, plane_tolerance, to_planes
from .separation import Separation
from .weighted_rows import weighted_rows

GRID = 2          # pixels between two probes, which stand in the middle of their cells
FINE = 1, 256     # the same in pictures of up to so many pixels
RELIABLE = 0.5    # weight of the probes around a pixel from which on it needs none of its own
LEAST = 1e-5      # weight that keeps the sum above zero
CHUNK = 8192      # probes at a time: what their rays hit stays in a processor's cache

Light = dict[str, Tensor]           # by name, (P, C)
ComputeLight = Callable[..., Light]  # of positions, normals (P, 3), numbers (P,), ...
# Of the light of probes (N, C) and the rows of neighbours (N, K) -> (N, K), 0 where they agree with their probe.
Difference = Callable[[Tensor, Tensor], Tensor]
Weights = tuple[Tensor, Tensor]     # numbers of the probes around pixels, row by row, and their weights, (P, K) both


class Filter(NamedTuple):
    """The mean of 5x5 probes."""

    spread: int                          # probes from each to the next
    difference: Difference | None = None  # where it is 1, probes count 1/e


SMOOTH, UNSMOOTHED = (Filter(1), Filter(2)), ()  # applied one after the other


def probe_grid(picture_size: int) -> int:
    """Pixels between two probes of a picture with this longer side."""
    grid, largest = FINE
    return grid if picture_size <= largest else GRID


class Probes:
    """Every `grid`-th pixel of a picture, at which light is computed for all of it.

    Each pixel takes the mean of the four nearest probes, weighted by edge stopping. Where these say little about it,
    there are more probes, down to every `finest` pixel. The weights are computed once for all kinds of light.
    """

    def __init__(self, position: Tensor, normal: Tensor, covered: Tensor, grid: int = GRID, finest: int = GRID,
                 separation: Separation | None = None, squarings: int = DIFFUSE):
        """position, normal: (h, w, 3); covered: (h, w, 1) bool, pixels that have a position; separation: of these.
        squarings: of edge stopping.
        """
        self.picture, self.grid, self.finest = (position, normal, covered), grid, finest
        self.squarings = squarings
        self.separation = separation if separation is not None and separation.exists else None
        self.rows, self.columns = (
            torch.arange(min(grid // 2, side - 1), side, grid, device=position.device) for side in position.shape[:2])
        self.number = _z_order(len(self.rows), len(self.columns), position.device)
        self.surfaces = self.at_probes(position), self.at_probes(normal)
        self.x, self.n = map(to_planes, self.surfaces)
        self.tolerance = plane_tolerance(self.x, self.at_probes(covered)[..., 0])
        self._neighbours = {}

    def interpolate(self, compute: ComputeLight, *per_pixel: Tensor, where: Tensor | None = None,
                    filters: Iterable[Filter] = UNSMOOTHED) -> Light:
        """Pictures (h, w, C) of the light that compute(position, normal, number, *per_pixel) returns for probes.

        per_pixel: (h, w, ...), further inputs, given for the probes. where: (h, w, 1) bool, the pixels that need
        light, by default all that are covered; it is 0 elsewhere.
        """
        where = self.picture[2] if where is None else where
        is_valid = self.at_probes(where).flatten()
        at, light, sizes = self._compute(compute, is_valid, per_pixel)
        if len(light) or where.any():
            light = self._interpolate(compute, per_pixel, where, is_valid, at, light, filters)
        else:
            light = light.new_zeros(*where.shape[:2], light.shape[1])
        return dict(zip(sizes, light.split(list(sizes.values()), -1), strict=True))

    def _interpolate(self, compute: ComputeLight, per_pixel: tuple[Tensor, ...], where: Tensor, is_valid: Tensor,
                     at: Tensor, light: Tensor, filters: Iterable[Filter]) -> Tensor:
        table = _with_weight(light.new_zeros(len(is_valid), light.shape[1]), at, light, is_valid)
        for spread, difference in filters:
            table = self._filter(table, spread, difference)
        probes = self
        while probes.grid > self.finest:
            coarse, reliability = _weighted_mean(table, probes._to_closer)
            probes = probes.closer
            is_valid = probes.at_probes(where).flatten()
            at, light, _ = probes._compute(compute, is_valid & (reliability < RELIABLE), per_pixel)
            table = _with_weight(coarse, at, light, is_valid)
        return _weighted_mean(table, probes._to_pixels)[0].view(*where.shape[:2], -1) * where

    @cached_property
    def closer(self) -> Probes:
        """Twice as many along each axis."""
        return Probes(*self.picture, self.grid // 2, self.finest, self.separation, self.squarings)

    def for_gloss(self) -> Probes:
        """The same for light that turns with the normal."""
        return Probes(*self.picture, self.grid, self.finest, self.separation, GLOSSY)

    def at_probes(self, picture: Tensor) -> Tensor:
        """(h, w, C) at all pixels -> at the probes."""
        return picture.index_select(0, self.rows).index_select(1, self.columns)

    def _compute(self, compute: ComputeLight, is_valid: Tensor,
                 per_pixel: tuple[Tensor, ...]) -> tuple[Tensor, Tensor, dict[str, int]]:
        """Numbers (P,) of the valid probes (rows columns,), their light (P, C), and how it divides by name."""
        at = is_valid.nonzero()[:, 0]  # waits for a GPU
        inputs = (*self.surfaces, *map(self.at_probes, per_pixel))
        position, normal, *inputs = (x.flatten(0, 1).index_select(0, at) for x in inputs)
        inputs = position, normal, self.number.flatten()[at], *inputs
        chunks = shared(compute, *(x.split(current_pieces().limit(CHUNK)) for x in inputs))
        sizes = {name: light.shape[1] for name, light in chunks[0].items()}
        return at, torch.cat([torch.cat(list(light.values()), 1) for light in chunks]), sizes

    @cached_property
    def _to_closer(self) -> Weights:
        return self._weights(self.closer.rows, self.closer.columns, self.closer.x, self.closer.n)

    @cached_property
    def _to_pixels(self) -> Weights:
        position, normal = self.picture[:2]
        pixels = (torch.arange(side, device=position.device) for side in position.shape[:2])
        return self._weights(*pixels, to_planes(position), to_planes(normal))

    def _weights(self, rows: Tensor, columns: Tensor, position: Tensor, normal: Tensor) -> Weights:
        """(h w, 4) for pixels in `rows` (h,) and `columns` (w,), with positions and normals (3, h, w)."""
        probes, numbers, weights = torch.cat([self.x, self.n, self.tolerance[None]]).flatten(1), [], []
        for down in (0, 1):
            for right in (0, 1):
                i, y = _neighbour(rows, len(self.rows), self.grid, down)
                j, z = _neighbour(columns, len(self.columns), self.grid, right)
                number = (len(self.columns) * i[:, None] + j).flatten()
                x, n, tolerance = probes.index_select(1, number).unflatten(1, normal.shape[1:]).split([3, 3, 1])
                weight = edge_weights(x - position, n, normal, tolerance[0], squarings=self.squarings)
                if self.separation is not None:
                    probe = self.rows[i][:, None], self.columns[j]
                    weight = weight * ~self.separation.between(rows[:, None], columns, *probe)
                weight = weight + LEAST
                numbers.append(number)
                weights.append((y[:, None] * z * weight).flatten())
        return torch.stack(numbers, -1), torch.stack(weights, -1)

    def _filter(self, table: Tensor, spread: int, difference: Difference | None) -> Tensor:
        """The same table with each probe the mean of 5x5 that stand `spread` apart."""
        if spread not in self._neighbours:
            self._neighbours[spread] = self._neighbour_weights(spread)
        number, weight = self._neighbours[spread]
        if difference is not None:
            weight = weight * (-difference(table[:, :-1], number).square()).exp()
        total = weighted_rows(table, number, weight)
        return torch.where(total[:, -1:] > 0, total / total[:, -1:].clamp_min(1e-12), table) * table[:, -1:]

    def _neighbour_weights(self, spread: int) -> Weights:
        number, weight = neighbour_weights(self.x, self.n, self.tolerance, spread, squarings=self.squarings)
        if self.separation is None:
            return number, weight
        row, column = (x.flatten()[:, None] for x in torch.meshgrid(self.rows, self.columns, indexing="ij"))
        return number, weight * ~self.separation.between(row, column, row.flatten()[number], column.flatten()[number])


def _with_weight(light: Tensor, at: Tensor, computed: Tensor, is_valid: Tensor) -> Tensor:
    """(N, C + 1) `light` (N, C), replaced by what was `computed` at some, and 1; all 0 where it is not valid."""
    table = F.pad(light, (0, 1), value=1.0) * is_valid[:, None]
    table[at, :-1] = computed
    return table


def _weighted_mean(table: Tensor, weights: Weights) -> tuple[Tensor, Tensor]:
    """(P, C) at pixels of the light in a table of probes, and (P,) how reliable it is, 1 at most."""
    light, reliability = weighted_rows(table, *weights).split([table.shape[1] - 1, 1], 1)
    return light / reliability.clamp(min=LEAST ** 2), reliability[:, 0]


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
