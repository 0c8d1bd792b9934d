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
from ..progress import standing_still
from .chunks import in_chunks
from .edge_stopping import DIFFUSE, GLOSSY, SIDE, edge_weights, neighbour_weights, plane_tolerance, to_planes
from .separation import Separation
from .weighted_rows import weighted_rows

GRID = 2          # pixels between two probes, which stand in the middle of their cells
FINE = 1, 256     # the same in pictures of up to so many pixels
RELIABLE = 0.5    # weight of the probes around a pixel from which on it needs none of its own
LEAST = 1e-5      # weight that keeps the sum above zero
EQUAL = 1e-5      # share of two values by which they differ at most where they are the same
CHUNK = 8192      # probes at a time: what their rays hit stays in a processor's cache

Light = dict[str, Tensor]           # by name, (P, C)
ComputeLight = Callable[..., Light]  # of positions, normals (P, 3), numbers (P,), ...
Around = Callable[[Tensor], Tensor]          # the mean of a value (N,) around each probe
Differ = Callable[[Tensor, Tensor], Tensor]  # of probes (P,) and those of numbers (P, K) -> (P, K), 0 where they agree
Difference = Callable[[Tensor, Around], Differ]  # of the light of probes (N, C)
Weights = tuple[Tensor, Tensor]     # numbers of the probes around pixels, row by row, and their weights, (P, K) both


class Filter(NamedTuple):
    """The mean of 5x5 probes."""

    spread: int                          # probes from each to the next
    difference: Difference | None = None  # where it is 1, probes count 1/e


SMOOTHED, UNSMOOTHED = (Filter(1),), ()  # applied one after the other


def probe_grid(picture_size: int) -> int:
    """Pixels between two probes of a picture with this longer side."""
    grid, largest = FINE
    return grid if picture_size <= largest else GRID


class Probes:
    """Every `grid`-th pixel of a picture, at which light is computed for all of it.

    Each pixel takes the mean of the four nearest probes, weighted by edge stopping. Where these say little about it,
    there are more probes, down to every `finest` pixel.
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
            with standing_still():
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
            closer = probes.closer
            is_valid = closer.at_probes(where).flatten()
            coarse, reliability = probes._means_at(closer, is_valid, table)
            at, light, _ = closer._compute(compute, is_valid & (reliability < RELIABLE), per_pixel)
            table, probes = _with_weight(coarse, at, light, is_valid), closer
        light = table[:, :-1] if probes.grid == 1 else probes._means_at(probes.pixels, where.flatten(), table)[0]
        return light.unflatten(0, where.shape[:2])

    @cached_property
    def closer(self) -> Probes:
        """Twice as many along each axis."""
        return Probes(*self.picture, self.grid // 2, self.finest, self.separation, self.squarings)

    @cached_property
    def pixels(self) -> Probes:
        """One at each pixel."""
        return Probes(*self.picture, 1, 1, self.separation, self.squarings)

    def for_gloss(self) -> Probes:
        """The same for light that turns with the normal."""
        return Probes(*self.picture, self.grid, self.finest, self.separation, GLOSSY)

    def at_probes(self, picture: Tensor) -> Tensor:
        """(h, w, C) at all pixels -> at the probes."""
        return picture.index_select(0, self.rows).index_select(1, self.columns)

    @cached_property
    def tolerance(self) -> Tensor:
        """(rows, columns), as of `edge_weights`."""
        return plane_tolerance(self.x, self.at_probes(self.picture[2])[..., 0])

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

    def _means_at(self, finer: Probes, wanted: Tensor, table: Tensor) -> tuple[Tensor, Tensor]:
        """(N, C) light at `wanted` probes (N,) of a finer grid from these, and (N,) how reliable it is, 1 at most."""
        def mean(row: Tensor) -> Tensor:
            light, reliability = weighted_rows(table, *self._weights(finer, row)).split([table.shape[1] - 1, 1], 1)
            return torch.cat([light / reliability.clamp(min=LEAST ** 2), reliability], 1)

        means = _at_rows(table.new_zeros(len(wanted), table.shape[1]), mean, wanted)
        return means[:, :-1], means[:, -1]

    def _weights(self, finer: Probes, row: Tensor) -> Weights:
        """Numbers and weights (P, 4) of the probes around those of a finer grid with numbers (P,)."""
        y, x = finer._places(row)
        (i, down), (j, right) = _neighbours(y, len(self.rows), self.grid), _neighbours(x, len(self.columns), self.grid)
        number = (len(self.columns) * i[:, :, None] + j[:, None]).flatten(1)
        there, normal, tolerance = (picture.flatten(-2)[..., number] for picture in (self.x, self.n, self.tolerance))
        position, own_normal = (picture.flatten(1)[:, row, None] for picture in (finer.x, finer.n))
        weight = edge_weights(there - position, normal, own_normal, tolerance, squarings=self.squarings)
        weight = weight * self._are_together(finer, row, number) + LEAST
        return number, (down[:, :, None] * right[:, None]).flatten(1) * weight

    def _filter(self, table: Tensor, spread: int, difference: Difference | None) -> Tensor:
        """The same table with each probe the mean of 5x5 that stand `spread` apart."""
        sides = self.number.shape
        around = lambda value: _mean_around(value.view(sides), spread).flatten()  # noqa: E731
        differ = difference and difference(table[:, :-1], around)

        def mean(row: Tensor) -> Tensor:
            number, weight = neighbour_weights(self.x, self.n, self.tolerance, row, spread, squarings=self.squarings)
            weight = weight * self._are_together(self, row, number)
            if differ:
                weight = weight * differ(row, number).square().neg_().exp_()
            total = weighted_rows(table, number, weight)
            return torch.where(total[:, -1:] > 0, total / total[:, -1:].clamp_min(1e-12), table[row])

        changes = varies(table.unflatten(0, sides), spread).flatten() & (table[:, -1] > 0)
        return _at_rows(table, mean, changes)

    def _are_together(self, others: Probes, row: Tensor, number: Tensor) -> Tensor | bool:
        """(P, K) bool: no wall is between `others` with numbers (P,) and these of numbers (P, K)."""
        if self.separation is None:
            return True
        return ~self.separation.between(*others._places(row[:, None]), *self._places(number))

    def _places(self, number: Tensor) -> tuple[Tensor, Tensor]:
        """Rows and columns of the picture in which probes stand."""
        columns = len(self.columns)
        return self.rows[number // columns], self.columns[number % columns]


def varies(light: Tensor, spread: int) -> Tensor:
    """(h, w) bool: whether light (h, w, C) is not the same at all of the 5x5 places that are `spread` apart."""
    light, reach = to_planes(light), SIDE // 2 * spread
    changes = torch.zeros_like(light[0])
    for axis in (1, 2):
        size = max(light.shape[axis] - spread, 0)
        before, after = (light.narrow(axis, light.shape[axis] - size if end else 0, size) for end in (0, 1))
        changes.narrow(axis - 1, light.shape[axis] - size, size).logical_or_(
            ((after - before).abs() > EQUAL * (after.abs() + before.abs())).any(0))
    for sides in ((2 * reach + 1, 1), (1, 2 * reach + 1)):
        changes = F.max_pool2d(changes[None], sides, 1, [side // 2 for side in sides])[0]
    return changes > 0


def _with_weight(light: Tensor, at: Tensor, computed: Tensor, is_valid: Tensor) -> Tensor:
    """(N, C + 1) `light` (N, C), replaced by what was `computed` at some, and 1; all 0 where it is not valid."""
    table = F.pad(light, (0, 1), value=1.0) * is_valid[:, None]
    table[at, :-1] = computed
    return table


def _at_rows(table: Tensor, compute: Callable[[Tensor], Tensor], wanted: Tensor) -> Tensor:
    """The table (N, C), with what is computed of numbers (P,) in the rows that are `wanted`, (N,) bool."""
    row = wanted.nonzero()[:, 0]  # waits for a GPU
    return table.index_put((row,), in_chunks(CHUNK, compute, row)) if len(row) else table


def _mean_around(value: Tensor, spread: int) -> Tensor:
    """(h, w) means of the 5x5 values (h, w) `spread` apart; those beyond the sides are as at the side."""
    reach = SIDE // 2 * spread
    padded = F.pad(value[None, None], (reach,) * 4, mode="replicate")[0, 0]
    for axis, side in enumerate(value.shape):
        padded = sum(padded.narrow(axis, spread * step, side) for step in range(SIDE)) / SIDE
    return padded


def _z_order(rows: int, columns: int, device: torch.device) -> Tensor:
    """(h, w) numbers that follow each other within every square of 2, 4, 8... probes, from 0 again every 64."""
    down, right = (sum(((i >> bit) & 1) << (2 * bit) for bit in range(6))
                   for i in (torch.arange(count, device=device) for count in (rows, columns)))
    return 2 * down[:, None] + right[None]


def _neighbours(pixels: Tensor, count: int, grid: int) -> tuple[Tensor, Tensor]:
    """(P, 2) indices of the probes before and behind pixels (P,) along an axis, and their linear weights."""
    at = ((pixels - grid // 2) / grid).clamp(0, count - 1)
    low = at.floor().long().clamp(max=max(count - 2, 0))
    share = at - low
    return torch.stack([low, (low + 1).clamp(max=count - 1)], 1), torch.stack([1 - share, share], 1)
