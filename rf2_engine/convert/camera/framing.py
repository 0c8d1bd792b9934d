# SPDX-License-Identifier: GPL-3.0-or-later
"""What a picture is fitted to; held over a shot, so that what does not move does not flicker."""
from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..meshes.reduce import COARSEST
from .apparent_size import ApparentSize

ROOM = 1.15   # what has to give gives so many times as much: room for others in the frames that follow
STEADY = 1.3  # a mesh keeps the triangles it had while those it should have are no more than so many times as many


@dataclass
class Framing:
    box: np.ndarray      # (2, 3) f32, lowest and highest corner of what becomes the network's box
    apparent: ApparentSize | None  # what triangles are allotted by; None: everything is seen alike
    shares: dict[tuple, int] = field(default_factory=dict)  # by mesh: how many triangles it had

    def steadied(self, keys: list[tuple], shares: np.ndarray, copies: np.ndarray, budget: int) -> np.ndarray:
        """(k,) int shares of meshes as they were when this was asked before, where that is about right and fits.

        keys: what meshes are known by; shares, copies: (k,) triangles they should have, and instances.
        """
        before = np.array([self.shares.get(key, share) for key, share in zip(keys, shares, strict=True)], np.int64)
        kept = np.where((before <= STEADY * shares) & (shares <= STEADY * before), before, shares)
        for i in np.argsort((shares - kept) * copies, kind="stable"):
            if kept @ copies <= budget or kept[i] <= shares[i]:
                break
            kept[i] = max(int(shares[i] / ROOM), min(shares[i], COARSEST))
        self.shares |= dict(zip(keys, kept.tolist(), strict=True))
        return kept
