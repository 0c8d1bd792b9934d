# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluate the shaders of media, homogeneous or textured."""
from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ....model.scene import CELLS
from ..data.medium import Box, Medium, voxel_centres

EVEN = 4          # cells per axis of a box that is the same everywhere
SAME_TINT = 0.05  # most difference in colour that is not worth a remark


def shaded_medium(name: str, box: Box, coefficients: Callable, report, filling: Callable | None = None) -> Medium:
    """coefficients: world places (r, r, r, 3) of all voxels of the box -> scattering and absorption, (3,) or (r, r, r,
    3), per world unit; filling: r -> (r, r, r) share of each voxel that is filled, None = all of it.

    Tokens of a box know one colour, so its colour is the mean one, and its extinction that of all colours together.
    """
    full = filling or (lambda resolution: np.ones((resolution,) * 3, np.float32))
    scattering, absorption = coefficients(voxel_centres(box, CELLS))
    if scattering.ndim == absorption.ndim == 1:
        return Medium(name, box, scattering, absorption, full, EVEN if filling is None else CELLS)
    scattering, absorption = (np.broadcast_to(c, (CELLS, CELLS, CELLS, 3)) for c in (scattering, absorption))
    each = scattering + absorption
    extinction = each.mean(axis=-1)
    thick = extinction.ravel() > 0
    tints = np.concatenate([scattering, each], axis=-1).reshape(-1, 6)[thick] / extinction.ravel()[thick, None]
    if len(tints) and np.ptp(tints, axis=0).max() > SAME_TINT:
        report.approximated(name, "the color of its volume varies: the mean is used")
    total = max(float(extinction.sum()), 1e-12)

    def density(resolution: int) -> np.ndarray:
        both = coefficients(voxel_centres(box, resolution))
        return full(resolution) * sum(np.float32(c).mean(axis=-1) for c in both)

    return Medium(name, box, scattering.sum(axis=(0, 1, 2)) / total, absorption.sum(axis=(0, 1, 2)) / total, density)
