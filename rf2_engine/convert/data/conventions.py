# SPDX-License-Identifier: GPL-3.0-or-later
"""Conventions of the file and of the Blender version: working space of colours, hash of Voronoi textures."""
from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ....model.color import LUMINANCE


@dataclass(frozen=True, eq=False)
class Conventions:
    """The file's colours are numbers in Linear Rec.709, or from Blender 5 on in the space that the user has chosen."""

    rec709: np.ndarray      # (3, 3) f32 its red, green and blue in that space
    voronoi_uses_pcg: bool  # as rf2_engine/compat.py has it

    def from_rec709(self, colors: np.ndarray) -> np.ndarray:
        """(..., 3) linear colours."""
        return colors @ self.rec709

    def luminance(self, colors: np.ndarray) -> np.ndarray:
        """(..., 1) of scene-linear colours (..., 3)."""
        return colors @ self._weights

    @cached_property
    def _weights(self) -> np.ndarray:
        return (np.linalg.inv(self.rec709) @ LUMINANCE[:, None]).astype(np.float32)
