# SPDX-License-Identifier: GPL-3.0-or-later
"""Scatter one point in each cell of a lattice, and find the nearest ones to a position (Worley 1996)."""
from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from ...data.arrays import mix_values, smoothstep
from .hashing import hash_color, hash_floats, hash_point, pcg
from .lattice import Lattice

FAR = np.float32(3e38)
FARTHEST = 2                    # cells between a position and the farthest neighbours that `smooth` reads
LEAST_WIDTH = np.float32(1e-9)
SAME_POINT = np.float32(1e-4)   # squared distance of points that share no edge
METRICS = {
    "EUCLIDEAN": lambda vector, exponent: np.sqrt(np.square(vector).sum(axis=0)),
    "MANHATTAN": lambda vector, exponent: np.abs(vector).sum(axis=0),
    "CHEBYCHEV": lambda vector, exponent: np.abs(vector).max(axis=0),
    "MINKOWSKI": lambda vector, exponent: (np.abs(vector) ** exponent).sum(axis=0) ** (1 / exponent),
}


@dataclass
class Cells:
    """Points (d, m) of one block among the cells of the lattice."""

    at: np.ndarray
    randomness: np.ndarray  # (m,)
    metric: str
    exponent: np.ndarray    # (m,)
    uses_pcg: bool          # Conventions.voronoi_uses_pcg

    def __post_init__(self):
        self.cell = np.floor(self.at)
        self.part = self.at - self.cell
        self.index = self.cell.astype(np.int64)
        self.points = Lattice(partial(scattered, uses_pcg=self.uses_pcg), self.index, -FARTHEST, FARTHEST)

    @cached_property
    def colors(self) -> Lattice:
        """(3, m) at an offset."""
        return Lattice(partial(colored, uses_pcg=self.uses_pcg), self.index, -FARTHEST, FARTHEST)

    def offsets(self, reach: int = 1) -> np.ndarray:
        """(k, d) offsets of the neighbours, x fastest."""
        side = 2 * reach + 1
        return np.indices([side] * len(self.at)).reshape(len(self.at), -1).T[:, ::-1] - reach

    def point(self, offset) -> np.ndarray:
        """(d, m) the point in a neighbour, from the corner of the own cell."""
        return self.points[offset] * self.randomness + np.float32(offset).reshape(len(self.at), -1)

    def distance(self, offset) -> np.ndarray:
        """(m,) from here to the point in a neighbour."""
        vector = self.point(offset) - self.part
        return np.abs(vector[0]) if len(vector) == 1 else METRICS[self.metric](vector, self.exponent)


def scattered(cell: np.ndarray, uses_pcg: bool) -> np.ndarray:
    """(d, ...) integers -> (d, ...) f32: where in its cell the point lies."""
    if len(cell) == 1:
        return hash_floats(*cell.astype(np.float32))[None]
    return pcg(cell) if uses_pcg else hash_point(*cell.astype(np.float32))


def colored(cell: np.ndarray, uses_pcg: bool) -> np.ndarray:
    """(d, ...) integers -> (3, ...) f32."""
    if len(cell) == 1 or not uses_pcg:
        return np.moveaxis(hash_color(*cell.astype(np.float32)), -1, 0)
    return pcg(cell if len(cell) > 2 else np.concatenate([cell, 0 * cell[:1]]))[:3]


def nearest(cells: Cells, rank: int):
    """Distance (m,), colour (m, 3) and position (m, d) of the nearest point, or of the second one at rank 1."""
    offsets, count = cells.offsets(), cells.at.shape[1]
    ranks = [(np.full(count, FAR), np.zeros(count, np.int64)) for _ in range(rank + 1)]
    for which, offset in enumerate(offsets):
        candidate = cells.distance(offset), which
        for i, current in enumerate(ranks):
            closer = candidate[0] < current[0]
            ranks[i] = tuple(np.where(closer, new, old) for new, old in zip(candidate, current, strict=True))
            if i < rank:
                candidate = tuple(np.where(closer, old, new) for new, old in zip(candidate, current, strict=True))
    distance, which = ranks[rank]
    offset = offsets[which].T
    return distance, cells.colors[offset].T, (cells.point(offset) + cells.cell).T


def smooth(cells: Cells, smoothness: np.ndarray, only_distance: bool = False):
    """As `nearest` of rank 0, blended over a width (m,); with `only_distance` colour and position are 0."""
    distance, others = None, (np.zeros((3, 1), np.float32), np.zeros((len(cells.at), 1), np.float32))
    smoothness = np.maximum(smoothness, LEAST_WIDTH)
    for offset in cells.offsets(FARTHEST):
        here = cells.distance(offset)
        if distance is None:
            distance, share = here, np.ones_like(here)
        else:
            share = smoothstep(0.5 + 0.5 * (distance - here) / smoothness)
            if not share.any():
                continue
        less = smoothness * share * (1 - share)
        distance = mix_values(distance, here, share) - less
        if not only_distance:
            less = less / (1 + 3 * smoothness)
            point = cells.colors[offset], cells.point(offset)
            others = tuple(mix_values(old, new, share) - less for old, new in zip(others, point, strict=True))
    color, position = others
    return distance, np.broadcast_to(color.T, (len(distance), 3)), (position + cells.cell).T


def to_edge(cells: Cells) -> np.ndarray:
    """(m,) distance to the nearest border between two points' regions."""
    vectors = [cells.point(offset) - cells.part for offset in cells.offsets()]
    if len(cells.at) == 1:
        left, middle, right = (vector[0] for vector in vectors)
        return np.minimum(np.abs(middle + left), np.abs(middle + right)) / 2
    closest, least = vectors[0], np.square(vectors[0]).sum(axis=0)
    for vector in vectors[1:]:
        squared = np.square(vector).sum(axis=0)
        closest, least = np.where(squared < least, vector, closest), np.minimum(squared, least)
    result = np.full(cells.at.shape[1], FAR)
    for vector in vectors:
        across = vector - closest
        squared = np.square(across).sum(axis=0)
        here = ((closest + vector) * across).sum(axis=0) / 2 / np.sqrt(np.maximum(squared, SAME_POINT))
        result = np.where(squared > SAME_POINT, np.minimum(result, here), result)
    return result


def sphere_radius(cells: Cells) -> np.ndarray:
    """(m,) half the way from the nearest point to the point that is nearest to that one."""
    offsets = cells.offsets()
    squares = [np.square(cells.point(offset) - cells.part).sum(axis=0) for offset in offsets]
    own = offsets[np.argmin(squares, axis=0)].T
    center, result = cells.point(own), FAR
    for offset in offsets:
        if offset.any():
            result = np.minimum(result, np.square(cells.point(own + offset[:, None]) - center).sum(axis=0))
    return np.sqrt(result) / 2
