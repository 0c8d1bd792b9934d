# SPDX-License-Identifier: GPL-3.0-or-later
"""The space in which the file's colours are numbers: Linear Rec.709, or from Blender 5 on what the user has chosen."""
from __future__ import annotations

from functools import cache

import numpy as np

from ....model.color import LUMINANCE
from ... import compat
from .images.image_files import scene_linear


def from_rec709(colors: np.ndarray) -> np.ndarray:
    """(..., 3) linear colours."""
    return colors @ _matrix(compat.working_space())


def luminance(colors: np.ndarray) -> np.ndarray:
    """(..., 1) of scene-linear colours (..., 3)."""
    return colors @ _weights(compat.working_space())


@cache
def _matrix(space: str) -> np.ndarray:
    """(3, 3) the red, green and blue of Rec.709 in the working space; `space`: its name."""
    primaries = np.eye(3, dtype=np.float32)
    return primaries if space == "Linear Rec.709" else scene_linear(primaries, "Linear Rec.709")


@cache
def _weights(space: str) -> np.ndarray:
    return (np.linalg.inv(_matrix(space)) @ LUMINANCE[:, None]).astype(np.float32)
