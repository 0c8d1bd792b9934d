# SPDX-License-Identifier: GPL-3.0-or-later
"""Fill the part of `Guides` for mirrors and glass: the ends of specular paths from the first hits."""
from __future__ import annotations

import math
from dataclasses import fields as dataclass_fields
from dataclasses import replace

import numpy as np

from ...camera import view_rays_at
from ...compute.threads import spread
from ...first_hits.camera_rays import CameraRays
from ...geometry import facing, reflected, refracted
from ...progress import part
from ...scene import IOR, ROUGHNESS, Guides, RenderScene, View
from ...scene_rays import scene_rays
from ...shading import surface
from ...surface_kinds import ALL, BENDING, Ray
from .facets import pixel_starts, rough_facets
from .paths import Lobe, Media, PathEnds, follow_paths

RAYS = {"reflected": Ray.GLOSSY, "refracted": Ray.TRANSMISSION}
LOBES = {"reflected": "mirrored", "refracted": "exit"}  # of what paths meet first
BOUNCES = {"reflected": "glossy", "refracted": "transmission"}
LEAST_COLOR = {"reflected": 0.08, "refracted": 0.05}  # of a lobe from which on paths are followed: above plastic's
PATHS = 1 << 18  # of a lobe, at most
CHUNK = 1 << 14  # paths that are followed at a time
FULL = "position", "light"  # fields in full floats, others in half ones


def add_path_ends(guides: Guides, scene: RenderScene, view: View) -> Guides:
    """Guides with the ends of specular paths, in world units as guides, scene and view are.

    In a large picture paths start at every second, third... pixel along either side.
    """
    colors = {"reflected": guides.glossy_color, "refracted": guides.transmission_color}
    pixels = {lobe: (color.max(-1) > LEAST_COLOR[lobe]) & (guides.hit_triangle >= 0) for lobe, color in colors.items()}
    if not any(mask.any() for mask in pixels.values()):
        return guides
    rays, most, media = scene_rays(scene), scene.most_bounces, _media(scene)
    fields = {}
    for lobe, mask in pixels.items():
        if not mask.any() or not min(most[BOUNCES[lobe]], most["all"]):
            continue
        everything = rays.among(ALL, RAYS[lobe])
        solid = rays.among(ALL & ~BENDING, RAYS[lobe]).closest if len(rays.rows(BENDING, RAYS[lobe])) else None
        step = max(math.ceil(math.sqrt(mask.sum() / PATHS)), 1)
        rows, columns = (step * index for index in np.nonzero(mask[::step, ::step]))

        def follow(rows: np.ndarray, columns: np.ndarray, lobe=lobe, cast=everything.closest, solid=solid,
                   step=step) -> PathEnds:
            start = pixel_starts(rows // step, columns // step) if lobe == "refracted" else None
            first = _first_segments(guides, scene, view, rows, columns, start)
            return follow_paths(scene, cast, *first, solid, media, start)

        chunks = [(rows[first:first + CHUNK], columns[first:first + CHUNK]) for first in range(0, len(rows), CHUNK)]
        with part(0.0, 1.0, "Tracing mirrors and glass"):
            ends = spread(follow, chunks)
        values = {f"{lobe}_{kind}": np.concatenate([getattr(chunk, kind) for chunk in ends])
                  for kind in ("position", "normal", "color", "light")}
        if lobe == "reflected":
            values["reflected_light"] *= values["reflected_normal"].any(1, keepdims=True)  # the rest is direct light
        if any(chunk.lobe.color.any() for chunk in ends):
            values |= {f"{LOBES[lobe]}_{kind.name}": np.concatenate([getattr(chunk.lobe, kind.name) for chunk in ends])
                       for kind in dataclass_fields(Lobe)}
        for name, value in values.items():
            picture = np.zeros((*mask.shape, value.shape[1]), np.float32 if name.endswith(FULL) else np.float16)
            picture[rows, columns] = value
            filled = picture[::step, ::step].repeat(step, 0).repeat(step, 1)[:mask.shape[0], :mask.shape[1]]
            fields[name] = np.where(mask[..., None], filled, 0)
    return replace(guides, **fields)


def _media(scene: RenderScene) -> Media | None:
    """What dims light along paths; None where nothing does."""
    if scene.volumes is None or not len(scene.volumes):
        return None
    from ..media.transmittance import fog_of  # PyTorch, which takes seconds to import
    return fog_of(scene, reach=math.inf).along


def _first_segments(guides: Guides, scene: RenderScene, view: View, rows: np.ndarray, columns: np.ndarray,
                    start: np.ndarray | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """World points (S, 3), unit directions (S, 3) in which paths leave the first hits of pixels, and the eye (3,).

    start: of `follow_paths`, of refractions; None of reflections.
    """
    eye, rays = view_rays_at(view, columns + 0.5, rows + 0.5)
    position, normal = guides.position[rows, columns], facing(guides.normal[rows, columns], rays)
    if start is None:
        direction = reflected(rays, normal)
    else:
        triangle = CameraRays(scene, view).closest(rays).triangle
        _, inside, texel = surface(scene, triangle, position, rays)
        facet = rough_facets(rays, normal, texel[:, ROUGHNESS], start, 0)
        direction = refracted(rays, facet, texel[:, IOR], inside)
    return position, direction, eye
