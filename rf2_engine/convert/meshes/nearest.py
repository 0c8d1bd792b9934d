# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the triangle of a mesh that is nearest to a point."""
from __future__ import annotations

import numpy as np

from ....model import progress
from ...bvh import tree_of, uncollected
from ..data import mesh as meshes
from .blocks import blocks, points_of

BATCH = 20_000  # points that are looked up before somebody asks about Esc


class Surface:
    """Triangles, found by places near them."""

    def __init__(self, points: np.ndarray, faces: np.ndarray):
        """points: (v, 3) f64; faces: (n, 3) i32."""
        self.blocks = blocks(meshes.middles(points[faces]))
        self.trees, self.boxes = [], []
        for i, rows in enumerate(self.blocks):
            progress.report(i / len(self.blocks))
            corners, shape = points_of(points, faces[rows])
            self.boxes.append((corners.min(axis=0), corners.max(axis=0)))
            self.trees.append(tree_of(corners, shape))

    def nearest(self, points: np.ndarray) -> np.ndarray:
        """(q,) i64: the triangle nearest to each of (q, 3) points."""
        away = np.stack([meshes.lengths(points - points.clip(low, high)) for low, high in self.boxes])
        home = away.argmin(axis=0)
        found, distance = np.zeros(len(points), np.int64), np.full(len(points), np.inf)
        rounds = [(block, np.flatnonzero(home == block)) for block in range(len(self.trees))]
        self._ask(rounds, points, found, distance, 0.0, 0.8)
        rounds = [(block, np.flatnonzero((home != block) & (away[block] < distance)))
                  for block in range(len(self.trees))]
        self._ask(rounds, points, found, distance, 0.8, 1.0)
        return found

    @uncollected()
    def _ask(self, rounds, points, found, distance, start: float, end: float) -> None:
        """Improve `found` and `distance` in place, by the tree of each block for some rows."""
        done, total = 0, sum(len(rows) for _, rows in rounds)
        for block, rows in rounds:
            for batch in np.split(rows, range(BATCH, len(rows), BATCH)) if len(rows) else ():
                progress.report(start + (end - start) * done / total)
                done += len(batch)
                answers = [self.trees[block].find_nearest(point)[2:] for point in points[batch].tolist()]
                index, near = (np.array(column) for column in zip(*answers, strict=True))
                better = near < distance[batch]
                found[batch[better]], distance[batch[better]] = self.blocks[block][index[better]], near[better]
