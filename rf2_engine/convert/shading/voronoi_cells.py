# SPDX-License-Identifier: GPL-3.0-or-later
"""Points scattered over a lattice, one in each cell, and what lies nearest to a place among them (Worley 1996)."""
from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from ... import compat
from .arrays import mixed, smoothstep
from .hashing import color_of_floats, of_floats, pcg, point_of_floats
from .lattice import Lattice

FAR = np.float32(3e38)
SAME_POINT = np.float32(1e-4)  # squared distance of points that share no edge
METRICS = {
    "EUCLIDEAN": lambda way, exponent: np.sqrt(np.square(way).sum(axis=0)),
    "MANHATTAN": lambda way, exponent: np.abs(way).sum(axis=0),
    "CHEBYCHEV": lambda way, exponent: np.abs(way).max(axis=0),
    "MINKOWSKI": lambda way, exponent: (np.abs(way) ** exponent).sum(axis=0) ** (1 / exponent),
}


@dataclass
class Cells:
    """Points (d, m) of one block among the cells of the lattice."""

    at: np.ndarray
    randomness: np.ndarray  # (m,)
    reach: int
    metric: str
    exponent: np.ndarray    # (m,)

    def __post_init__(self):
        self.cell = np.floor(self.at)
        self.part = self.at - self.cell
        self.whole = self.cell.astype(np.int64)
        self.points = Lattice(scattered, self.whole, -self.reach, self.reach)

    def offsets(self):
        """Of the neighbours, x fastest."""
        around = range(-self.reach, self.reach + 1)
        return [offset[::-1] for offset in itertools.product(around, repeat=len(self.at))]

    def point(self, offset) -> np.ndarray:
        """(d, m) the point in a neighbour, from the corner of the own cell."""
        return self.points[offset] * self.randomness + np.float32(offset)[:, None]

    def distance(self, way) -> np.ndarray:
        return np.abs(way[0]) if len(way) == 1 else METRICS[self.metric](way, self.exponent)

    def colors(self, offset) -> np.ndarray:
        """(m, 3) of the neighbours at offsets (d,) or (d, m)."""
        return colored(self.whole + np.reshape(offset, (len(self.at), -1)))


def scattered(cell: np.ndarray) -> np.ndarray:
    """(d, ...) integers -> (d, ...) f32: where in its cell the point lies."""
    if len(cell) == 1:
        return of_floats(*cell.astype(np.float32))[None]
    return pcg(cell) if compat.voronoi_uses_pcg() else point_of_floats(*cell.astype(np.float32))


def colored(cell: np.ndarray) -> np.ndarray:
    """(d, m) integers -> (m, 3) f32."""
    if len(cell) == 1 or not compat.voronoi_uses_pcg():
        return color_of_floats(*cell.astype(np.float32))
    return pcg(cell if len(cell) > 2 else np.concatenate([cell, 0 * cell[:1]]))[:3].T


def nearest(cells: Cells, rank: int):
    """Distance (m,), colour (m, 3) and position (m, d) of the nearest point, or of the second one at rank 1."""
    nowhere = np.full(cells.at.shape[1], FAR), np.zeros_like(cells.at), np.zeros_like(cells.at)
    best = [nowhere] * (rank + 1)
    for offset in cells.offsets():
        point = cells.point(offset)
        found = cells.distance(point - cells.part), point, np.broadcast_to(np.float32(offset)[:, None], point.shape)
        for i, known in enumerate(best):
            closer = found[0] < known[0]
            best[i] = tuple(np.where(closer, new, old) for new, old in zip(found, known, strict=True))
            found = tuple(np.where(closer, old, new) for new, old in zip(found, known, strict=True))
    distance, point, offset = best[rank]
    return distance, cells.colors(offset.astype(np.int64)), (point + cells.cell).T


def smooth(cells: Cells, smoothness: np.ndarray):
    """As `nearest` of rank 0, blended over a width (m,)."""
    distance = color = position = None
    smoothness = np.maximum(smoothness, 1e-9)
    for offset in cells.offsets():
        point = cells.point(offset)
        here = cells.distance(point - cells.part)
        if distance is None:
            distance, color, position, share = here, np.float32(0), np.float32(0), np.ones_like(here)
        else:
            share = smoothstep(0.5 + 0.5 * (distance - here) / smoothness)
        less = smoothness * share * (1 - share)
        distance = mixed(distance, here, share) - less
        less = less / (1 + 3 * smoothness)
        color = mixed(color, cells.colors(offset).T, share) - less
        position = mixed(position, point, share) - less
    return distance, color.T, (position + cells.cell).T


def to_edge(cells: Cells) -> np.ndarray:
    """(m,) distance to the nearest border between two points' regions."""
    ways = [cells.point(offset) - cells.part for offset in cells.offsets()]
    if len(cells.at) == 1:
        left, middle, right = (way[0] for way in ways)
        return np.minimum(np.abs(middle + left), np.abs(middle + right)) / 2
    closest, least = ways[0], np.square(ways[0]).sum(axis=0)
    for way in ways[1:]:
        squared = np.square(way).sum(axis=0)
        closest, least = np.where(squared < least, way, closest), np.minimum(squared, least)
    result = np.full(cells.at.shape[1], FAR)
    for way in ways:
        across = way - closest
        squared = np.square(across).sum(axis=0)
        here = ((closest + way) * across).sum(axis=0) / 2 / np.sqrt(np.maximum(squared, SAME_POINT))
        result = np.where(squared > SAME_POINT, np.minimum(result, here), result)
    return result


def sphere_radius(cells: Cells) -> np.ndarray:
    """(m,) half the way from the nearest point to the point that is nearest to that one."""
    offsets = cells.offsets()
    centre, own, least = np.zeros_like(cells.at), np.zeros(cells.at.shape, np.int64), FAR
    for offset in offsets:
        point = cells.point(offset)
        squared = np.square(point - cells.part).sum(axis=0)
        closer = squared < least
        own = np.where(closer, np.array(offset)[:, None], own)
        centre, least = np.where(closer, point, centre), np.minimum(squared, least)
    result = FAR
    for offset in offsets:
        if any(offset):
            other = own + np.array(offset)[:, None]
            point = other + scattered(cells.whole + other) * cells.randomness
            result = np.minimum(result, np.square(point - centre).sum(axis=0))
    return np.sqrt(result) / 2
