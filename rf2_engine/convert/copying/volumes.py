# SPDX-License-Identifier: GPL-3.0-or-later
"""Volume objects, simulated smoke and fire, copied out of Blender at the frame that is evaluated."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..data.blocks import Material
from ..data.copied import CopiedVolume, Grid, Instance
from ..data.report import Report
from ..media.volumes import DEFAULT_GRID
from ..shading.volume import find_grid_names, has_volume
from .vdb import openvdb_module, read_grids
from .visibility import gas_domain

CHANNELS = {"density": 1, "flame": 1, "heat": 1, "temperature": 1, "color": 4}


def gridded(obj, material: Material | None, instance: Instance, grids_read: dict[tuple, dict[str, Grid]],
            report: Report) -> CopiedVolume | None:
    """The grids of an evaluated Volume object or of a domain of gas; None, and a remark, if it shows none.

    grids_read: of objects before; what is read now is added.
    """
    domain = gas_domain(obj)
    if not has_volume(material) and (material or domain):
        report.skipped(obj.name, f'its material "{material.name}" has no volume shader' if material
                       else "it has no material with a volume shader")
        return None
    names, openvdb = find_grid_names(material) if material else [DEFAULT_GRID], openvdb_module()
    # In render space OBJECT Cycles divides the coefficients by the root mean square of the scale.
    is_per_world_unit = bool(domain) or obj.data.render.space != "OBJECT"
    copied = CopiedVolume(obj.name, material, instance, np.array(obj.bound_box), None, is_per_world_unit)
    if openvdb is None and not domain:
        return copied
    key = obj.as_pointer() if domain else obj.data.as_pointer(), *names
    if key not in grids_read:
        grids_read[key] = read_gas_grids(domain, obj, names) if domain else read_grids(openvdb, obj.data, names)
    if grids_read[key]:
        return replace(copied, grids=grids_read[key])
    report.skipped(obj.name, f"it has no grid {' or '.join(names)}, which its shader uses" if names
                   else "its shader uses no grid, so it is invisible, as in Cycles")
    return None


def read_gas_grids(domain, obj, names: list[str]) -> dict[str, Grid]:
    """The grids of FluidDomainSettings that have one of these names; none where nothing was simulated.

    obj: the evaluated domain, as large as its grids at this frame.
    """
    low, high = np.array(obj.bound_box, np.float64)[[0, 6]]
    grids = {}
    for name in names:
        values = _values(getattr(domain, f"{name}_grid"), domain, CHANNELS[name]) if name in CHANNELS else None
        if values is not None:
            to_object = np.diag([*((high - low) / values.shape[:3]), 1.0])
            to_object[:3, 3] = low
            grids[name] = Grid(values, to_object)
    return grids


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
