# SPDX-License-Identifier: GPL-3.0-or-later
"""Find what the camera sees, and where, by a coarse raster of rays."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ....model.camera import view_rays_at
from ....model.rays import Rays
from ....model.scene import View
from ..data.collected import Collected
from ..meshes.sampling import keep_some
from .panes import is_pane

GRID = 64                 # rays along either side of the picture
FEW = GRID * GRID // 144  # that hit something else than light
PANES = 3                 # one behind the other, that are looked through
BEHIND = 3                # times as far away as a pane is what counts instead of it
TRIANGLES = 40_000        # of stand-ins, about as many as a BVH of a tenth of a second holds
LEAST = 12                # of a mesh
BOX = np.array([(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
                (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)])  # corners of a box's triangles


@dataclass
class Hits:
    """P of the GRID x GRID rays hit something."""

    points: np.ndarray    # (P, 3) f64, world
    instance: np.ndarray  # (P,) i64 counted over the matrices of all parts in their order; -1 = a medium

    def __len__(self) -> int:
        return len(self.points)

    def distances(self, eye: np.ndarray) -> np.ndarray:
        """(P,) from a point (3,)."""
        return np.linalg.norm(self.points - eye, axis=1)


def visible_points(collected: Collected, view: View, clip_start: float = 0.0) -> Hits:
    """What the view sees from `clip_start` on (camera.py).

    It sees through what shines, unless there is hardly anything else: a sky dome is no more than a background; and
    through panes that fill most of the picture, far in front of what is behind them.
    """
    shown = {i for i, part in enumerate(collected.parts) if part.is_shown and not part.emits}
    hits = _cast(collected, view, clip_start, shown)
    if len(hits) < FEW:
        return _cast(collected, view, clip_start, {i for i, part in enumerate(collected.parts) if part.is_shown})
    owner = np.repeat(np.arange(len(collected.parts)), [len(part.places) for part in collected.parts])
    eye, behind = view.camera_to_world[:3, 3], hits
    for _ in range(PANES):
        parts, counts = np.unique(owner[behind.instance[behind.instance >= 0]], return_counts=True)
        if not len(parts) or counts.max() < len(behind) / 2 or not is_pane(collected.parts[parts[counts.argmax()]]):
            break
        shown -= {parts[counts.argmax()]}
        behind = _cast(collected, view, clip_start, shown)
    far = len(behind) >= FEW and np.median(behind.distances(eye)) > BEHIND * np.median(hits.distances(eye))
    return behind if far else hits


def _cast(collected: Collected, view: View, clip_start: float, shown: set[int]) -> Hits:
    """shown: indices of the parts that there are for these rays."""
    triangles, owner = _stand_ins(collected, view.camera_to_world[:3, 3], shown)
    if not len(triangles):
        return Hits(np.zeros((0, 3)), np.zeros(0, np.int64))
    x, y = np.meshgrid((np.arange(GRID) + 0.5) / GRID * view.width, (np.arange(GRID) + 0.5) / GRID * view.height)
    if view.panorama is None:
        eye, rays = view_rays_at(view, x.ravel(), y.ravel())
        starts = rays * clip_start / -(rays @ view.camera_to_world[:3, 2:3])
    else:
        inside = view.panorama.seen(x + view.corner[0], y + view.corner[1])
        eye, rays = view_rays_at(view, x[inside], y[inside])
        starts = rays * clip_start
    met = Rays(triangles - eye).closest(starts, rays)
    hit = met.triangle >= 0
    return Hits(eye + starts[hit] + met.distance[hit, None] * rays[hit], owner[met.triangle[hit]])


def _stand_ins(collected: Collected, eye: np.ndarray, visible: set[int]) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3, 3) world triangles that look alike from afar, and (n,) whose: of a fine mesh some, enlarged.

    Fog around the eye (3,) is looked through.
    """
    placed = [medium.box.corners()[BOX] for medium in collected.media if not medium.box.holds(eye)]
    owner = [np.full(len(box), -1) for box in placed]
    shows = [i in visible for i in range(len(collected.parts))]
    instances = sum(len(part.matrices) for part, shown in zip(collected.parts, shows, strict=True) if shown)
    share = max(TRIANGLES // max(instances, 1), LEAST)
    before = 0
    for part, shown in zip(collected.parts, shows, strict=True):
        copies = len(part.matrices)
        if shown:
            corners = part.mesh.corners
            if len(corners) > share:
                kept, growth = keep_some(np.ones(len(corners)), share)
                some, middle = corners[kept], corners[kept].mean(axis=1, keepdims=True)
                corners = middle + (some - middle) * growth[kept, None, None]
            matrix = np.array(part.matrices)[:, None]
            world = corners.astype(np.float64) @ matrix[..., :3, :3].swapaxes(-1, -2) + matrix[..., None, :3, 3]
            placed.append(world.reshape(-1, 3, 3))
            owner.append(np.repeat(before + np.arange(copies), len(corners)))
        before += copies
    if not placed:
        return np.zeros((0, 3, 3)), np.zeros(0, np.int64)
    return np.concatenate(placed), np.concatenate(owner)
