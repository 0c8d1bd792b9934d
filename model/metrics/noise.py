# SPDX-License-Identifier: GPL-3.0-or-later
"""How much of the difference between two pictures is noise of the reference: no render comes closer than that."""
from __future__ import annotations

import numpy as np

BLOCK = 8        # pixels along the side of a square that is judged as one
TRIMMED = 0.2    # share of squares left out at either end: edges that one picture smooths look like the other's noise
WEIGHTS = 36.0   # sum of the squares of the mask's numbers
FEWEST = 16      # squares


def excess(a: np.ndarray, b: np.ndarray) -> float:
    """Variance of what noise `b` has beyond that of `a`; both are (H, W, 3) of one view, and it is of their values.

    0 where pictures are too small to tell. Noise is what no neighbour predicts (Immerkaer 1996, a Laplacian that
    shading does not reach); textures are in both.
    """
    difference = _squared(b) - _squared(a)
    height, width = (size // BLOCK * BLOCK for size in difference.shape[:2])
    blocks = difference[:height, :width].reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK, -1).mean((1, 3, 4))
    if blocks.size < FEWEST:
        return 0.0
    beyond = int(blocks.size * TRIMMED)
    kept = np.sort(blocks, axis=None)[beyond:-beyond]
    return max(float(kept.mean()), 0.0) / WEIGHTS


def _squared(picture: np.ndarray) -> np.ndarray:
    """(H - 2, W - 2, 3) squares of the mask [1 -2 1] in both directions."""
    for _ in range(2):
        picture = (picture[2:] - 2 * picture[1:-1] + picture[:-2]).swapaxes(0, 1)
    return picture.astype(np.float64) ** 2
