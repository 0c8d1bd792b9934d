# SPDX-License-Identifier: GPL-3.0-or-later
"""The part of `Guides` for mirrors and glass: the surfaces that they show, by rays through the token triangles."""
from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..camera import view_rays_at
from ..compute.threads import spread
from ..geometry import corner_weights, facing, reflected, refracted
from ..progress import part
from ..rays import Rays
from ..scene import IOR, Guides, RenderScene, View
from ..shading import surface
from .occluders import bends_light
from .specular_paths import Cast, Ends, follow

LEAST_COLOR = {"reflected": 0.08, "refracted": 0.05}  # of a lobe whose pixels are looked at: more than plastic's gloss
RAYS = 1 << 18   # of a lobe, at most
CHUNK = 1 << 14  # paths that are followed at once
ENDS = {"position": np.float32, "normal": np.float16, "color": np.float16, "light": np.float32}


def with_ends(guides: Guides, scene: RenderScene, view: View, rays: Rays | None = None) -> Guides:
    """Guides with the surfaces that smooth reflections and refractions end at, in world units as they are.

    Of a large picture only every second, third... pixel along either side is looked at. rays: against the scene's
    triangles, for whoever has them already.
    """
    colors = {"reflected": guides.glossy_color, "refracted": guides.transmission_color}
    shown = {name: (color.max(-1) > LEAST_COLOR[name]) & (guides.hit_triangle >= 0) for name, color in colors.items()}
    if not any(pixels.any() for pixels in shown.values()):
        return guides
    rays, solid = rays or Rays(scene.triangles), _solid(scene)
    found = {}
    for name, pixels in shown.items():
        if not pixels.any():
            continue
        step = max(math.ceil(math.sqrt(pixels.sum() / RAYS)), 1)
        rows, columns = (step * index for index in np.nonzero(pixels[::step, ::step]))

        def ends(rows: np.ndarray, columns: np.ndarray, name: str = name) -> Ends:
            return follow(scene, rays.closest, *_leaving(name, guides, scene, view, rows, columns), solid)

        places = [(rows[first:first + CHUNK], columns[first:first + CHUNK]) for first in range(0, len(rows), CHUNK)]
        with part(0.0, 1.0, "Tracing mirrors and glass"):
            parts = spread(ends, places)
        arrays = {kind: np.zeros((*pixels.shape, 3), dtype) for kind, dtype in ENDS.items()
                  if hasattr(guides, f"{name}_{kind}")}  # of what mirrors show the light prior knows the light
        for kind, array in arrays.items():
            array[rows, columns] = np.concatenate([getattr(ends_of, kind) for ends_of in parts])
        for kind, array in arrays.items():
            filled = array[::step, ::step].repeat(step, 0).repeat(step, 1)[:pixels.shape[0], :pixels.shape[1]]
            found[f"{name}_{kind}"] = np.where(pixels[..., None], filled, 0)
    return replace(guides, **found)


def _solid(scene: RenderScene) -> Cast | None:
    """A cast for the scene's triangles that are no glass; None where there is none of it."""
    glass = bends_light(scene)
    if not glass.any():
        return None
    row, rays = np.append(np.flatnonzero(~glass), -1), Rays(scene.triangles[~glass])

    def cast(origin: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        met = rays.closest(origin, direction)
        return row[met.triangle], met.distance
    return cast


def hit_points(scene: RenderScene, guides: Guides, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """(S, 3) places of pixels on the token triangles: from beside simplified ones a path would pass them once more."""
    weights = corner_weights(guides.hit_barycentric[rows, columns])
    return np.einsum("sk,skc->sc", weights, scene.triangles[guides.hit_triangle[rows, columns]])


def _leaving(name: str, guides: Guides, scene: RenderScene, view: View, rows: np.ndarray,
             columns: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """World points (S, 3), unit directions (S, 3) of what is reflected or refracted at pixels, and the eye (3,)."""
    eye, rays = view_rays_at(view, columns + 0.5, rows + 0.5)
    position, normal = hit_points(scene, guides, rows, columns), facing(guides.normal[rows, columns], rays)
    if name == "reflected":
        away = reflected(rays, normal)
    else:
        _, inside, texel = surface(scene, guides.hit_triangle[rows, columns], position, rays)
        away = refracted(rays, normal, texel[:, IOR], inside)
    return position, away, eye
