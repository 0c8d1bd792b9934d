# SPDX-License-Identifier: GPL-3.0-or-later
"""The box and view that a scene is fitted to; later frames keep those of a key frame, against flicker."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..meshes.reduce import COARSEST
from .apparent_size import ApparentSize

ROOM = 1.15   # what has to give gives so many times as much: room for others in the frames that follow
STEADY = 1.3  # a mesh keeps its triangles while those it should have are no more than so many times as many
STEP = 1.3    # between the numbers of triangles that a mesh may have otherwise


@dataclass
class Framing:
    box: np.ndarray      # (2, 3) f32, lowest and highest corner of what becomes the network's box
    apparent: ApparentSize | None  # what triangles are allotted by; None: everything is seen alike
    shares: dict[tuple, int] | None = None  # by mesh, its triangles in the key frame; None until that is known

    def steadied(self, keys: list[tuple], shares: np.ndarray, counts: np.ndarray, copies: np.ndarray,
                 budget: int) -> np.ndarray:
        """(k,) int shares of meshes as they are in the key frame, where that is about right and fits.

        keys: what meshes are known by; shares, counts, copies: (k,) triangles they should have and have, and instances.
        The first time this is asked is the key frame.
        """
        if self.shares is None:
            self.shares = dict(zip(keys, shares.tolist(), strict=True))
            return shares
        before = np.array([self.shares.get(key, 0) for key in keys], np.int64)
        about_right = (before <= STEADY * shares) & (shares <= STEADY * before)
        kept = np.where(about_right, before, np.where(shares < counts, _stepped(shares, shares), shares))
        less = _stepped(shares / ROOM, shares)
        for i in np.argsort((shares - kept) * copies, kind="stable"):
            if kept @ copies <= budget or kept[i] <= shares[i]:
                break
            kept[i] = less[i]
        return kept


def _stepped(wanted: np.ndarray, most: np.ndarray) -> np.ndarray:
    """(k,) powers of STEP up to what is wanted, but no less than COARSEST or, where that is less, `most`."""
    powers = STEP ** np.floor(np.log(np.maximum(wanted, 1)) / np.log(STEP) + 1e-9)
    return np.maximum(powers.astype(np.int64), np.minimum(most, COARSEST))
