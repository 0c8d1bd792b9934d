# SPDX-License-Identifier: GPL-3.0-or-later
"""Volume objects and simulated gas, copied out of Blender."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..data.blocks import Material
from ..data.copied import Grid, Gridded
from ..data.instance import Place
from ..media.volumes import DEFAULT_GRID
from ..shading.volume import grid_names, has_volume
from .gas import gas_grids
from .vdb import openvdb_module, read_grids
from .visibility import gas_domain


def gridded(obj, material: Material | None, place: Place, known: dict[tuple, dict[str, Grid]],
            report) -> Gridded | None:
    """The grids of an evaluated Volume object or of a domain of gas; None, and a remark, if it shows none.

    known: what was read before.
    """
    domain = gas_domain(obj)
    if not has_volume(material) and (material or domain):
        report.skipped(obj.name, f'its material "{material.name}" has no volume shader' if material
                       else "it has no material with a volume shader")
        return None
    names, openvdb = grid_names(material) if material else [DEFAULT_GRID], openvdb_module()
    # In render space OBJECT Cycles divides the coefficients by the root mean square of the scale.
    apart = bool(domain) or obj.data.render.space != "OBJECT"
    found = Gridded(obj.name, material, place, np.array(obj.bound_box), None, apart)
    if openvdb is None and not domain:
        return found
    key = obj.as_pointer() if domain else obj.data.as_pointer(), *names
    if key not in known:
        known[key] = gas_grids(domain, obj, names) if domain else read_grids(openvdb, obj.data, names)
    if known[key]:
        return replace(found, grids=known[key])
    report.skipped(obj.name, f"it has no grid {' or '.join(names)}, which its shader uses" if names
                   else "its shader uses no grid, so it is invisible, as in Cycles")
    return None
