# SPDX-License-Identifier: GPL-3.0-or-later
"""What a texture node shows of its image, once it is read (copying/images.py)."""
from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..node_call import NodeCall
from .pyramid import Pyramid

MISSING = np.array([1.0, 0.0, 1.0, 1.0], np.float32)  # magenta, as Blender shows a missing image
FIRST_TILE, TILES_IN_A_ROW = 1001, 10


@dataclass(frozen=True)
class Picture:
    """Of an image at the frame that is rendered."""

    source: str                                                       # as of a `bpy.types.Image`; "" without one
    pyramids: dict[int | None, Pyramid] = field(default_factory=dict)  # of each UDIM tile; None: of the whole image
    missing: dict[int | None, str] = field(default_factory=dict)       # what to say of those that cannot be read

    def pyramid(self, n: NodeCall, tile: int | None = None) -> Pyramid:
        """One magenta texel, which is reported, where there are no pixels."""
        if tile in self.missing:
            n.folded(self.missing[tile])
        return self.pyramids[tile]
