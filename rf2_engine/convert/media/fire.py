# SPDX-License-Identifier: GPL-3.0-or-later
"""The light that media send out by themselves."""
from __future__ import annotations

import numpy as np

from ....model.scene import Fire
from ..data.medium import Medium, voxel_centres

VOXELS = 16  # along the sides of a medium's box


def fire_of(media: list[Medium]) -> Fire | None:
    """All voxels of media that shine; None if none do."""
    parts = [part for medium in media if medium.emission is not None and len(part := _shining(medium))]
    return Fire.concatenate(parts) if parts else None


def _shining(medium: Medium) -> Fire:
    emission, size = medium.emission(VOXELS), np.cbrt(np.prod(medium.box.size / VOXELS))
    shines = emission.any(axis=-1)
    position, radiance = voxel_centres(medium.box, VOXELS)[shines], emission[shines] * size
    return Fire(position.astype(np.float32), radiance.astype(np.float32), np.full(len(position), size, np.float32))
