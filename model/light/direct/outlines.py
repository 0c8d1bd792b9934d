# SPDX-License-Identifier: GPL-3.0-or-later
"""Outlines of flat convex emitters: rings of corners, which light is integrated over edge by edge."""
from __future__ import annotations

import numpy as np

from ...geometry import area_vectors

MOST_CORNERS = RING = 12  # of an outline; points in a ring around one
FLAT = 1e-3               # share of its area that a surface may lose when it is seen as the polygon of its outline
TURNS = 2 * np.pi * np.arange(RING) / RING
CIRCLE = np.float32(np.stack([np.cos(TURNS), np.sin(TURNS)], 1) * np.sqrt(TURNS[1] / np.sin(TURNS[1])))  # unit, by area


def convex_outline(shape: np.ndarray) -> np.ndarray | None:
    """(K, 3) corners around a flat convex surface of triangles (n, 3, 3); None for others and finer ones."""
    vectors = area_vectors(shape.astype(np.float64))
    total = vectors.sum(axis=0)
    area, points = np.linalg.norm(total), shape.reshape(-1, 3).astype(np.float64)
    if not area or np.linalg.norm(vectors, axis=1).sum() > (1 + FLAT) * area:
        return None
    normal = total / area
    heights = points @ normal
    if np.ptp(heights) ** 2 > FLAT * area:
        return None
    side = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    side /= np.linalg.norm(side)
    hull = points[_hull(np.stack([points @ side, points @ np.cross(normal, side)], axis=1))]
    if len(hull) > MOST_CORNERS or abs(np.linalg.norm(outline_vectors(hull)) - area) > FLAT * area:
        return None
    return hull.astype(np.float32)


def cut(corners: np.ndarray, count: int) -> list[np.ndarray]:
    """So many convex pieces (K, 3) of a flat convex outline (K, 3): the longest is halved across its longest edge."""
    pieces = [corners]
    while len(pieces) < count:
        along = [_along_longest_edge(piece) for piece in pieces]
        longest = int(np.argmax([np.ptp(places) for places in along]))
        piece, places = pieces.pop(longest), along[longest]
        places = places - (places.min() + places.max()) / 2
        pieces += [_clipped(piece, places), _clipped(piece, -places)]
    return pieces


def _along_longest_edge(corners: np.ndarray) -> np.ndarray:
    """(K,) places of corners (K, 3)."""
    edges = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(edges, axis=1)
    return corners @ (edges[lengths.argmax()] / max(lengths.max(), 1e-30))


def _clipped(corners: np.ndarray, side: np.ndarray) -> np.ndarray:
    """The part of a convex outline (K, 3) where `side` (K,), linear in between, is not negative."""
    kept = []
    for i in range(len(corners)):
        j = (i + 1) % len(corners)
        if side[i] >= 0:
            kept.append(corners[i])
        if side[i] * side[j] < 0:
            kept.append(corners[i] + (corners[j] - corners[i]) * side[i] / (side[i] - side[j]))
    return np.float32(kept)


def outline_vectors(corners: np.ndarray) -> np.ndarray:
    """(..., 3) normal times area of flat polygons with corners (..., K, 3), counter-clockwise from the front."""
    around = corners - corners[..., :1, :]
    return np.cross(around, np.roll(around, -1, axis=-2)).sum(axis=-2) / 2


def padded(outlines: list[np.ndarray]) -> np.ndarray:
    """(P, K, 3) f32 of outlines with at most K corners; the first corner stands for those that are missing."""
    most = max((len(corners) for corners in outlines), default=3)
    rings = [np.concatenate([corners, np.repeat(corners[:1], most - len(corners), axis=0)]) for corners in outlines]
    return np.array(rings, np.float32).reshape(-1, most, 3)


def rings(corners: np.ndarray) -> np.ndarray:
    """(P, RING, 7) f32 points in order on padded outlines (P, K, 3): all corners, more on longer edges.

    Where the edge of each begins, the whole edge, and how much of it lies before the point.
    """
    result = np.zeros((len(corners), RING, 7), np.float32)
    for ring, outline in zip(result, corners.astype(np.float64), strict=True):
        edges = np.roll(outline, -1, axis=0) - outline
        lengths = np.linalg.norm(edges, axis=1)
        parts = (lengths > 0).astype(int)
        while 0 < parts.sum() < RING:
            parts[(lengths / np.maximum(parts, 1)).argmax()] += 1
        points = [(*start, *edge, i / count) for start, edge, count in zip(outline, edges, parts, strict=True)
                  for i in range(count)]
        ring[:] = points or (*outline[0], 0, 0, 0, 0)
    return result


def ring_points(rings: np.ndarray) -> np.ndarray:
    """(P, RING, 3) places of the points of `rings`."""
    return rings[..., :3] + rings[..., 3:6] * rings[..., 6:]


def fans(corners: np.ndarray) -> np.ndarray:
    """(P, K - 1) share of the area of padded outlines (P, K, 3) in the first 0, 1, 2... triangles around corner 0."""
    around = corners[:, 1:].astype(np.float64) - corners[:, :1]
    areas = np.linalg.norm(np.cross(around[:, :-1], around[:, 1:]), axis=-1)
    areas = np.cumsum(areas, axis=1) / np.maximum(areas.sum(axis=1, keepdims=True), 1e-30)
    return np.pad(areas, ((0, 0), (1, 0)))


def _hull(points: np.ndarray) -> list[int]:
    """Rows of the corners of the convex hull of points (n, 2), counter-clockwise (Andrew's monotone chain)."""
    order = [int(i) for i in np.lexsort(points.T[::-1])]
    tolerance = 1e-9 * max(float(np.ptp(points, axis=0).max()) ** 2, 1e-30)

    def chain(rows: list[int]) -> list[int]:
        hull = []
        for row in rows:
            while len(hull) > 1 and _turn(*points[[*hull[-2:], row]]) <= tolerance:
                hull.pop()
            hull.append(row)
        return hull[:-1]

    return chain(order) + chain(order[::-1])


def _turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    """Twice the area of a triangle, positive for a turn to the left."""
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
