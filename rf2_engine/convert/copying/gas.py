# SPDX-License-Identifier: GPL-3.0-or-later
"""Simulated smoke and fire: the grids of a domain at the frame that is evaluated."""
from __future__ import annotations

import numpy as np

from ..data.copied import Grid

CHANNELS = {"density": 1, "flame": 1, "heat": 1, "temperature": 1, "color": 4}


def gas_grids(domain, obj, names: list[str]) -> dict[str, Grid]:
    """Those of FluidDomainSettings that have one of these names; none where nothing was simulated.

    obj: the evaluated domain, as large as its grids at this frame.
    """
    low, high = np.array(obj.bound_box, np.float64)[[0, 6]]
    found = {}
    for name in names:
        values = _values(getattr(domain, f"{name}_grid"), domain, CHANNELS[name]) if name in CHANNELS else None
        if values is not None:
            to_object = np.diag([*((high - low) / values.shape[:3]), 1.0])
            to_object[:3, 3] = low
            found[name] = Grid(values, to_object)
    return found


def _values(grid, domain, channels: int) -> np.ndarray | None:
    """(x, y, z, 1 or 3) f32; noise makes grids several times as fine."""
    flat = np.empty(len(grid), np.float32)
    grid.foreach_get(flat)
    shape = np.array(domain.domain_resolution)
    fine = round((len(flat) / channels / max(shape.prod(), 1)) ** (1 / 3))
    if not flat.any() or not fine or len(flat) != channels * (shape * fine).prod():
        return None
    values = np.maximum(np.nan_to_num(flat), 0).reshape(*(shape * fine)[::-1], channels).transpose(2, 1, 0, 3)
    if channels == 1:
        return values
    return values[..., :3] / np.where(values[..., 3:] > 0, values[..., 3:], 1)
