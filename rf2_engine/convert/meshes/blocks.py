# SPDX-License-Identifier: GPL-3.0-or-later
"""Divide a large mesh into blocks, so that Esc does not wait for one long call of Blender or QSlim."""
from __future__ import annotations

import numpy as np

LARGEST = 60_000  # triangles: a tenth of a second or two


def blocks(middles: np.ndarray, largest: int = LARGEST) -> list[np.ndarray]:
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


def points_of(points: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The points (k, 3) that some faces (n, 3) have, and those faces by these points, i32."""
    own = np.zeros(len(points), bool)
    own[faces] = True
    return points[own], (np.cumsum(own, dtype=np.int32) - 1)[faces]
