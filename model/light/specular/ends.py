# SPDX-License-Identifier: GPL-3.0-or-later
"""Fill the part of `Guides` for mirrors and glass: the ends of specular paths from the first hits."""
from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ...camera import view_rays_at
from ...compute.threads import spread
from ...geometry import corner_weights, facing, reflected, refracted
from ...progress import part
from ...rays import Rays
from ...scene import IOR, Guides, RenderScene, View
from ...shading import surface
from ..occluders import bends_light
from .paths import Cast, PathEnds, follow_paths

LEAST_COLOR = {"reflected": 0.08, "refracted": 0.05}  # of a lobe from which on paths are followed: above plastic's
PATHS = 1 << 18  # of a lobe, at most
CHUNK = 1 << 14  # paths that are followed at a time
DTYPES = {"position": np.float32, "normal": np.float16, "color": np.float16, "light": np.float32}


def add_path_ends(guides: Guides, scene: RenderScene, view: View, rays: Rays | None = None) -> Guides:
    """Guides with the ends of specular paths, in world units as guides, scene and view are.

    In a large picture paths start at every second, third... pixel along either side. rays: against the scene's
    triangles, if they exist already.
    """
    colors = {"reflected": guides.glossy_color, "refracted": guides.transmission_color}
    pixels = {lobe: (color.max(-1) > LEAST_COLOR[lobe]) & (guides.hit_triangle >= 0) for lobe, color in colors.items()}
    if not any(mask.any() for mask in pixels.values()):
        return guides
    rays, solid = rays or Rays(scene.triangles), _cast_at_solid(scene)
    fields = {}
    for lobe, mask in pixels.items():
        if not mask.any():
            continue
        step = max(math.ceil(math.sqrt(mask.sum() / PATHS)), 1)
        rows, columns = (step * index for index in np.nonzero(mask[::step, ::step]))

        def follow(rows: np.ndarray, columns: np.ndarray, lobe: str = lobe) -> PathEnds:
            return follow_paths(scene, rays.closest, *_first_segments(lobe, guides, scene, view, rows, columns), solid)

        chunks = [(rows[first:first + CHUNK], columns[first:first + CHUNK]) for first in range(0, len(rows), CHUNK)]
        with part(0.0, 1.0, "Tracing mirrors and glass"):
            ends = spread(follow, chunks)
        for kind, dtype in DTYPES.items():
            name = f"{lobe}_{kind}"
            if not hasattr(guides, name):  # DirectLight computes the lamps that mirrors show
                continue
            picture = np.zeros((*mask.shape, 3), dtype)
            picture[rows, columns] = np.concatenate([getattr(chunk, kind) for chunk in ends])
            filled = picture[::step, ::step].repeat(step, 0).repeat(step, 1)[:mask.shape[0], :mask.shape[1]]
            fields[name] = np.where(mask[..., None], filled, 0)
    return replace(guides, **fields)


def _cast_at_solid(scene: RenderScene) -> Cast | None:
    """Closest hits of everything but glass; None for a scene without glass."""
    is_glass = bends_light(scene)
    if not is_glass.any():
        return None
    row, rays = np.append(np.flatnonzero(~is_glass), -1), Rays(scene.triangles[~is_glass])

    def cast(origin: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        hits = rays.closest(origin, direction)
        return row[hits.triangle], hits.distance
    return cast


def hit_points(scene: RenderScene, guides: Guides, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """(S, 3) points of pixels on the token triangles: a path from beside simplified ones would pass them once more."""
    weights = corner_weights(guides.hit_barycentric[rows, columns])
    return np.einsum("sk,skc->sc", weights, scene.triangles[guides.hit_triangle[rows, columns]])


def _first_segments(lobe: str, guides: Guides, scene: RenderScene, view: View, rows: np.ndarray,
                    columns: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """World points (S, 3), unit directions (S, 3) in which paths leave the first hits of pixels, and the eye (3,)."""
    eye, rays = view_rays_at(view, columns + 0.5, rows + 0.5)
    position, normal = hit_points(scene, guides, rows, columns), facing(guides.normal[rows, columns], rays)
    if lobe == "reflected":
        direction = reflected(rays, normal)
    else:
        _, inside, texel = surface(scene, guides.hit_triangle[rows, columns], position, rays)
        direction = refracted(rays, normal, texel[:, IOR], inside)
    return position, direction, eye
