# SPDX-License-Identifier: GPL-3.0-or-later
"""Find what the camera sees, and where, by a coarse raster of rays that looks through panes close to the camera."""
from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ....model.camera import clip_distances, view_rays_at
from ....model.geometry import area_vectors
from ....model.rays import Rays
from ....model.scene import View
from ....model.surface_kinds import Ray
from ..data.blocks import Material
from ..data.collected import CollectedScene, Part
from ..data.copied import Instance
from ..data.mesh import TriangleMesh
from ..data.report import Report
from ..meshes.sampling import keep_sample
from ..shading.material import evaluate_material
from ..shading.points import surface_points
from ..shading.tile_arrays import mean_over_triangle

GRID = 64                 # rays along either side of the picture
FEW = GRID * GRID // 144  # that hit something that does not emit
PANES = 3                 # one behind the other, that rays pass
BEHIND = 3                # times as far away as a pane is what counts instead of it
TRIANGLES = 40_000        # of stand-ins, about as many as a BVH of a tenth of a second holds
LEAST = 12                # of a mesh
BOX = np.array([(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
                (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)])  # corners of a box's triangles
FLAT = 0.9     # length of the mean of the unit normals, either side up, of a pane: curved ones too, but no vessel
CLEAR = 0.5    # of the light that goes through a pane
SMOOTH = 0.3   # roughness up to which glass shows what is behind it
SAMPLE = 64    # triangles that are examined


@dataclass
class VisiblePoints:
    """What P of the GRID x GRID rays hit."""

    points: np.ndarray    # (P, 3) f64, world
    instance: np.ndarray  # (P,) i64 counted over the matrices of all parts in their order; -1 = a medium

    def __len__(self) -> int:
        return len(self.points)

    def distances(self, eye: np.ndarray) -> np.ndarray:
        """(P,) from a point (3,)."""
        return np.linalg.norm(self.points - eye, axis=1)


def find_visible(collected: CollectedScene, view: View) -> VisiblePoints:
    """What the view sees.

    It sees through emitters, unless there is hardly anything else: a sky dome is no more than a background; and
    through panes and media that fill most of the picture, far in front of what is behind them.
    """
    visible = {i for i, part in enumerate(collected.parts) if part.is_shown and not part.emits}
    hits = _cast(collected, view, visible)
    if len(hits) < FEW:
        return _cast(collected, view, {i for i, part in enumerate(collected.parts) if part.is_shown})
    owner = np.repeat(np.arange(len(collected.parts)), [len(part.instances) for part in collected.parts])
    eye, behind = view.camera_to_world[:3, 3], hits
    for _ in range(PANES):
        is_part = behind.instance >= 0
        parts, counts = np.unique(owner[behind.instance[is_part]], return_counts=True)
        if np.count_nonzero(~is_part) > len(behind) / 2:
            collected = replace(collected, media=[])
        elif len(parts) and counts.max() >= len(behind) / 2 and is_pane(collected.parts[parts[counts.argmax()]]):
            visible -= {parts[counts.argmax()]}
        else:
            break
        behind = _cast(collected, view, visible)
    far = len(behind) >= FEW and np.median(behind.distances(eye)) > BEHIND * np.median(hits.distances(eye))
    return behind if far else hits


def _cast(collected: CollectedScene, view: View, visible: set[int]) -> VisiblePoints:
    """visible: indices of the parts that rays hit."""
    triangles, owner = _stand_ins(collected, view.camera_to_world[:3, 3], visible)
    if not len(triangles):
        return VisiblePoints(np.zeros((0, 3)), np.zeros(0, np.int64))
    x, y = np.meshgrid((np.arange(GRID) + 0.5) / GRID * view.width, (np.arange(GRID) + 0.5) / GRID * view.height)
    if view.panorama is None:
        eye, rays = view_rays_at(view, x.ravel(), y.ravel())
    else:
        inside = view.panorama.visible(x + view.corner[0], y + view.corner[1])
        eye, rays = view_rays_at(view, x[inside], y[inside])
    starts = rays * clip_distances(view, rays)[:, None]
    hits = Rays(triangles - eye).closest(starts, rays)
    is_hit = hits.triangle >= 0
    points = eye + starts[is_hit] + hits.distance[is_hit, None] * rays[is_hit]
    return VisiblePoints(points, owner[hits.triangle[is_hit]])


def _stand_ins(collected: CollectedScene, eye: np.ndarray, indices: set[int]) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3, 3) world triangles that look alike from afar, and (n,) whose: of a fine mesh some, enlarged.

    Fog around the eye (3,) is ignored.
    """
    triangles = [medium.box.corners()[BOX] for medium in collected.media if not medium.box.holds(eye)]
    owner = [np.full(len(box), -1) for box in triangles]
    shows = [i in indices for i in range(len(collected.parts))]
    instances = sum(len(part.matrices) for part, is_visible in zip(collected.parts, shows, strict=True) if is_visible)
    share = max(TRIANGLES // max(instances, 1), LEAST)
    before = 0
    for part, is_visible in zip(collected.parts, shows, strict=True):
        copies = len(part.matrices)
        if is_visible:
            corners = part.mesh.corners
            if len(corners) > share:
                is_kept, growth = keep_sample(np.ones(len(corners)), share)
                some, middle = corners[is_kept], corners[is_kept].mean(axis=1, keepdims=True)
                corners = middle + (some - middle) * growth[is_kept, None, None]
            matrix = np.array(part.matrices)[:, None]
            world = corners.astype(np.float64) @ matrix[..., :3, :3].swapaxes(-1, -2) + matrix[..., None, :3, 3]
            triangles.append(world.reshape(-1, 3, 3))
            owner.append(np.repeat(before + np.arange(copies), len(corners)))
        before += copies
    if not triangles:
        return np.zeros((0, 3, 3)), np.zeros(0, np.int64)
    return np.concatenate(triangles), np.concatenate(owner)


def is_pane(part: Part) -> bool:
    """Whether a part is about flat, and what is behind it shows."""
    some = part.mesh.take(np.linspace(0, len(part.mesh) - 1, min(SAMPLE, len(part.mesh))).astype(int))
    normals = area_vectors(some.corners.astype(np.float64))
    largest = normals[np.square(normals).sum(axis=1).argmax()]
    aligned = normals * np.where(normals @ largest < 0, -1, 1)[:, None]
    if np.linalg.norm(aligned.sum(axis=0)) < FLAT * np.linalg.norm(normals, axis=1).sum():
        return False
    shares = [_transmitted_share(part.materials[slot], some.take(some.slot == slot), part.instances[0])
              for slot in np.unique(some.slot)]
    return bool(np.mean(np.concatenate(shares)) > CLEAR)


def _transmitted_share(material: Material | None, mesh: TriangleMesh, instance: Instance) -> np.ndarray:
    """(n,) share of light that goes straight, or through SMOOTH glass, at triangles with one material."""
    if material is None:
        return np.zeros(len(mesh))
    surface = evaluate_material(material, surface_points(mesh, instance, ray=Ray.CAMERA), Report()).surface
    straight = surface.clear.mean(axis=-1, keepdims=True)
    through = straight + (1 - straight) * surface.transmission * (surface.roughness <= SMOOTH)
    return np.broadcast_to(mean_over_triangle(through)[..., 0], len(mesh))
