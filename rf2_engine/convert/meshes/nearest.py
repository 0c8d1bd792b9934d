# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the triangle of a mesh that is nearest to a point; divide meshes into blocks, between which Esc is checked."""
from __future__ import annotations

import numpy as np

from ....model import progress
from ...bvh import build_tree, uncollected
from ..data import mesh as meshes

LARGEST = 60_000  # triangles of a block: a tenth of a second or two
BATCH = 20_000  # points that are looked up between two checks of Esc


def divide(middles: np.ndarray, largest: int = LARGEST) -> list[np.ndarray]:
    """Indices of (n, 3) points, halved along the longest side of their box until at most `largest` are together."""
    columns = np.ascontiguousarray(middles.T)
    waiting, done = [np.arange(len(middles))], []
    while waiting:
        rows = waiting.pop()
        if len(rows) <= largest:
            done.append(rows)
            continue
        here = columns.take(rows, axis=1)
        order = np.argpartition(here[np.ptp(here, axis=1).argmax()], len(rows) // 2)
        waiting += [rows[order[len(rows) // 2:]], rows[order[:len(rows) // 2]]]
    return done


def submesh(points: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The points (k, 3) that faces (n, 3) use, and the faces as indices of them, i32."""
    own = np.zeros(len(points), bool)
    own[faces] = True
    return points[own], (np.cumsum(own, dtype=np.int32) - 1)[faces]


class NearestTriangles:
    """Finds the triangle of a mesh that is nearest to a point."""

    def __init__(self, points: np.ndarray, faces: np.ndarray):
        """points: (v, 3) f64; faces: (n, 3) i32."""
        self.blocks = divide(meshes.middles(points[faces]))
        self.trees, self.boxes = [], []
        for i, rows in enumerate(self.blocks):
            progress.report(i / len(self.blocks))
            corners, shape = submesh(points, faces[rows])
            self.boxes.append((corners.min(axis=0), corners.max(axis=0)))
            self.trees.append(build_tree(corners, shape))

    def nearest(self, points: np.ndarray) -> np.ndarray:
        """(q,) i64: the triangle nearest to each of (q, 3) points."""
        away = np.stack([meshes.lengths(points - points.clip(low, high)) for low, high in self.boxes])
        home = away.argmin(axis=0)
        nearest, distance = np.zeros(len(points), np.int64), np.full(len(points), np.inf)
        rounds = [(block, np.flatnonzero(home == block)) for block in range(len(self.trees))]
        self._search(rounds, points, nearest, distance, 0.0, 0.8)
        rounds = [(block, np.flatnonzero((home != block) & (away[block] < distance)))
                  for block in range(len(self.trees))]
        self._search(rounds, points, nearest, distance, 0.8, 1.0)
        return nearest

    @uncollected()
    def _search(self, rounds, points, nearest, distance, start: float, end: float) -> None:
        """Improve `nearest` and `distance` in place, by the tree of each block for some rows."""
        done, total = 0, sum(len(rows) for _, rows in rounds)
        for block, rows in rounds:
            for batch in np.split(rows, range(BATCH, len(rows), BATCH)) if len(rows) else ():
                progress.report(start + (end - start) * done / total)
                done += len(batch)
                answers = [self.trees[block].find_nearest(point)[2:] for point in points[batch].tolist()]
                index, near = (np.array(column) for column in zip(*answers, strict=True))
                better = near < distance[batch]
                nearest[batch[better]], distance[batch[better]] = self.blocks[block][index[better]], near[better]
