# SPDX-License-Identifier: GPL-3.0-or-later
"""Volume objects and meshes with a volume shader as occupied cells (docs/scene-input.md 5, mostly 5.3-5.6)."""
from __future__ import annotations

import heapq
from dataclasses import fields

import numpy as np

from ....model import progress
from ....model.geometry import euler_angles
from ....model.scene import CELLS, VOXELS, Volumes
from ..data.medium import Medium, voxel_centres
from ..data.report import Report

MAX_CELLS = 1024          # what the published networks were trained with (docs/scene-input.md 2.4)
# A cell is dropped whose densest voxel is not above this fraction of the box's maximum, and whose optical depth is not
# above this either, unless there is no room for such cells.
OCCUPIED, CLEAR = 0.02, 0.004
FINE_MEDIA = 16, 128      # of the largest begin with CELLS per axis, with half as many; all others with a quarter


def cells(media: list[Medium], report: Report) -> Volumes | None:
    """All occupied cells, at most `MAX_CELLS`; None if there are none.

    Where they do not fit thin cells are dropped first, and then boxes are drawn with fewer, larger cells (the finest
    first), which the report says.
    """
    per_axis = _choose_resolutions(media)
    clear, parts = CLEAR, []
    for i, medium in enumerate(media):
        with progress.part(0.7 * i / len(media), 0.7 * (i + 1) / len(media)):
            parts.append(_occupied(medium, per_axis[i], clear))
    if sum(map(len, parts)) > MAX_CELLS:
        clear = np.inf
        parts = [_denser(part) for part in parts]
    with progress.part(0.7, 1.0):
        _coarsen(media, per_axis, parts, clear)
    room = MAX_CELLS
    for i, medium in enumerate(media):
        if len(parts[i]) > room:
            report.skipped(medium.name, f"the scene has more than {MAX_CELLS} volume cells")
            parts[i] = _occupied(medium, 0, clear)
        elif len(parts[i]) == 0 and (medium.emission is None or not medium.emission(1).any()):
            report.skipped(medium.name, "the volume is empty")
        elif len(parts[i]) and per_axis[i] < medium.finest:
            report.approximated(medium.name, f"rendered with {per_axis[i]} cells per axis instead of {medium.finest}")
        room -= len(parts[i])
    return Volumes.concatenate(parts) if any(map(len, parts)) else None


def _choose_resolutions(media: list[Medium]) -> list[int]:
    """The cells per axis that each medium begins with."""
    per_axis = [CELLS] * len(media)
    for rank, i in enumerate(np.argsort([-np.prod(medium.box.size) for medium in media], kind="stable")):
        per_axis[i] = min(CELLS >> sum(rank >= most for most in FINE_MEDIA), media[i].finest)
    return per_axis


def _coarsen(media: list[Medium], per_axis: list[int], parts: list[Volumes], clear: float) -> None:
    """Halve `per_axis` of the medium with the smallest cells, and make its `parts` anew, until at most `MAX_CELLS` are
    left; `clear`: as CLEAR."""
    too_many = surplus = sum(map(len, parts)) - MAX_CELLS
    finest_first = [(float(np.prod(medium.box.size) * (CELLS / per_axis[i]) ** 3), i)
                    for i, medium in enumerate(media)]
    heapq.heapify(finest_first)
    while surplus > 0 and finest_first:
        volume, i = heapq.heappop(finest_first)
        per_axis[i] //= 2
        done = max(1 - surplus / too_many, 0)
        with progress.part(done, done):
            before, parts[i] = len(parts[i]), _occupied(media[i], per_axis[i], clear)
        surplus += len(parts[i]) - before
        if per_axis[i] > 1:
            heapq.heappush(finest_first, (volume * 8, i))


def _occupied(medium: Medium, per_axis: int, clear: float) -> Volumes:
    """The cells of one medium on a `per_axis`^3 grid; `clear`: as CLEAR.

    The network derives the size of a cell from its box: `CELLS` of them per axis. A coarser grid is therefore the
    middle of a proportionally larger box.
    """
    progress.report()
    n, box = per_axis, medium.box
    density = medium.voxels(n * VOXELS) if n else np.zeros((0, 0, 0))
    peak = float(density.max(initial=0))
    blocks = (density / (peak or 1)).reshape(n, VOXELS, n, VOXELS, n, VOXELS).transpose(0, 2, 4, 5, 3, 1)
    extinction = peak * (medium.scattering + medium.absorption).max()
    least = min(OCCUPIED, clear / max(extinction * box.size.max() / max(n, 1), 1e-30))
    is_occupied = blocks.max(axis=(3, 4, 5), initial=0) > least
    position = voxel_centres(box, n)[is_occupied] if n else np.zeros((0, 3))
    count = len(position)
    scale = box.size * CELLS / max(n, 1)
    # Coefficients belong to a box whose optical depth does not change with its size (docs/scene-input.md 5.4).
    unit = peak * np.sqrt(np.mean(np.square(scale)))
    rows = (euler_angles(box.rotation), scale, medium.scattering * unit, medium.absorption * unit)
    return Volumes(blocks[is_occupied].reshape(count, VOXELS ** 3).astype(np.float32), position.astype(np.float32),
                   *(np.tile(row, (count, 1)).astype(np.float32) for row in rows))


def _denser(cells: Volumes) -> Volumes:
    """The cells whose density exceeds OCCUPIED somewhere."""
    is_dense = cells.density.max(axis=1, initial=0) > OCCUPIED
    return Volumes(*(getattr(cells, f.name)[is_dense] for f in fields(cells)))
