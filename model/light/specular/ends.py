# SPDX-License-Identifier: GPL-3.0-or-later
"""Fill the part of `Guides` for mirrors and glass: the ends of specular paths from the first hits."""
from __future__ import annotations

import math
from dataclasses import fields as dataclass_fields
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from ...camera import view_rays_at
from ...compute.threads import spread
from ...first_hits.camera_rays import CameraRays
from ...first_hits.hit_materials import least_hit_roughness
from ...first_hits.sheets import sheet_tiles
from ...geometry import facing, reflected, refracted
from ...progress import part
from ...scene import IOR, ROUGHNESS, Guides, RenderScene, View
from ...scene_rays import scene_rays
from ...shading import bent_to_reflect, side_normals, surface
from ...surface_kinds import ALL, BENDING, SEEN, STRAIGHT_THROUGH, Kind, Ray
from .end_albedo import mean_albedo
from .facets import pixel_starts, rough_facets
from .follow_paths import follow_paths
from .glass import Cast, lost, mirrored_by_plates
from .path_lobes import LIFT, first_reach
from .paths import BLURRED, Casts, Media, PathEnds, Sheets

PATHS = 1 << 18  # of a lobe, at most
CHUNK = 1 << 14  # paths that are followed at a time
MET = ALL & ~Kind.BACK  # by paths
KEPT = {field.name for field in dataclass_fields(Guides)}
FULL = "position", "light"  # fields in full floats, others in half ones


class PathLobe(NamedTuple):
    """A lobe along which paths leave first hits: `albedo` and `bounces` are what Guides and most bounces call it."""

    name: str
    albedo: str
    bounces: str
    ray: Ray
    least_albedo: float     # above which paths are followed,
    most_roughness: float   # and below which
    first_lobe: str         # names of `PathEnds.lobe` and `PathEnds.other`
    other_lobe: str

    def is_followed(self, albedo, roughness):
        """(h, w) bool: whether paths leave surfaces with this albedo (h, w, 3) of the lobe and this roughness (h, w),
        arrays or tensors."""
        return (albedo > self.least_albedo).any(-1) & (roughness < self.most_roughness)


REFLECTED = PathLobe("reflected", "glossy_albedo", "glossy", Ray.GLOSSY, 0.02, BLURRED, "mirrored", "layer")
REFRACTED = PathLobe("refracted", "transmission_color", "transmission", Ray.TRANSMISSION, 0.05, math.inf, "exit",
                     "inner")


def add_path_ends(guides: Guides, scene: RenderScene, view: View) -> Guides:
    """Guides with the ends of specular paths, in world units as guides, scene and view are.

    In a large picture paths start at every second, third... pixel along either side.
    """
    is_hit, roughness = guides.hit_triangle >= 0, least_hit_roughness(scene, guides)
    masks = {lobe: is_hit & lobe.is_followed(getattr(guides, lobe.albedo), roughness) for lobe in (REFLECTED, REFRACTED)
             if min(scene.most_bounces[lobe.bounces], scene.most_bounces["all"])}
    masks = {lobe: mask for lobe, mask in masks.items() if mask.any()}
    if not masks:
        return guides
    media, fire = _media(scene)
    fields = {}
    for lobe, mask in masks.items():
        step = max(math.ceil(math.sqrt(mask.sum() / PATHS)), 1)
        rows, columns = (step * index for index in np.nonzero(mask[::step, ::step]))
        ends = _follow(guides, scene, view, lobe, rows, columns, step, media, fire)
        for name, value in _values(scene, ends, lobe, rows // step, columns // step).items():
            picture = np.zeros((*mask.shape, value.shape[1]), np.float32 if name.endswith(FULL) else np.float16)
            picture[rows, columns] = value
            filled = picture[::step, ::step].repeat(step, 0).repeat(step, 1)[:mask.shape[0], :mask.shape[1]]
            fields[name] = np.where(mask[..., None], filled, 0)
    return replace(guides, **fields)


def _follow(guides: Guides, scene: RenderScene, view: View, lobe: PathLobe, rows: np.ndarray, columns: np.ndarray,
            step: int, media: Media | None, fire: Media | None) -> PathEnds:
    """Of the paths of some pixels, every `step`-th."""
    rays = scene_rays(scene)
    passes_sheets = guides.straight is not None and lobe.ray == Ray.TRANSMISSION
    clear, seen = (sheet_tiles(scene), rays.among(SEEN, Ray.CAMERA).closest) if passes_sheets else (None, None)
    # Where paths start at half-transparent sheets, these are not what touches glass.
    touched = MET & ~BENDING if guides.straight is None else MET & ~BENDING & ~STRAIGHT_THROUGH
    kinds = (MET, touched, BENDING) if len(rays.rows(BENDING, lobe.ray)) else (MET,)
    casts = Casts(*(rays.among(kind, lobe.ray).closest for kind in kinds))

    def follow(rows: np.ndarray, columns: np.ndarray) -> PathEnds:
        start = pixel_starts(rows // step, columns // step) if lobe.ray == Ray.TRANSMISSION else None
        first = _first_segments(guides, scene, view, casts.everything, rows, columns, start)
        sheets = Sheets(clear, guides.straight[rows, columns], seen) if passes_sheets else None
        ends = follow_paths(scene, casts, first.position, first.direction, first.eye, media, start, sheets, first.entry,
                            fire)
        ends.scale(first.factor)
        return ends

    chunks = [(rows[first:first + CHUNK], columns[first:first + CHUNK]) for first in range(0, len(rows), CHUNK)]
    with part(0.0, 1.0, "Tracing mirrors and glass"):
        return PathEnds.joined(spread(follow, chunks))


def _values(scene: RenderScene, ends: PathEnds, lobe: PathLobe, row: np.ndarray,
            column: np.ndarray) -> dict[str, np.ndarray]:
    """Fields of Guides, of all paths (S, C), which start in rows and columns (S,)."""
    color = ends.share * mean_albedo(scene, row, column, ends.position, ends.normal, ends.triangle, ends.albedo)
    # What reflections see without another surface on the way is direct light.
    light = ends.light * ends.normal.any(1, keepdims=True) if lobe.ray == Ray.GLOSSY else ends.light
    values = {"position": ends.position, "normal": ends.normal, "color": color, "light": light}
    if scene.group is not None:
        values["group"] = scene.group[scene.surfaces.token[ends.triangle]][:, None]
    values = {f"{lobe.name}_{kind}": value for kind, value in values.items()}
    names = lobe.first_lobe, lobe.other_lobe, f"{lobe.name}_gloss"
    for name, shown in zip(names, (ends.lobe, ends.other, ends.gloss), strict=True):
        if shown.color.any():
            values |= {field: value for kind, value in vars(shown).items() if (field := f"{name}_{kind}") in KEPT}
    return values


def _media(scene: RenderScene) -> tuple[Media | None, Media | None]:
    """What dims light along paths, and what adds to it; None where nothing does."""
    if not scene.volumes and scene.fire is None:
        return None, None
    from ..media.ray_march import fire_along  # PyTorch, which takes seconds to import
    from ..media.transmittance import fog_of
    fog = fog_of(scene, reach=math.inf)
    return fog.along if scene.volumes else None, None if fog.emission is None else partial(fire_along, fog)


class FirstSegments(NamedTuple):
    """Paths as they leave the first hits of S pixels."""

    position: np.ndarray   # (S, 3) f32, world
    direction: np.ndarray  # (S, 3) unit
    eye: np.ndarray        # (3,) or (S, 3)
    factor: np.ndarray     # (S, 1 or 3) of what they show: 0 for lost ones, more than 1 for plates' reflections
    entry: np.ndarray | None = None  # (S, 3) normals, where they enter glass


def _first_segments(guides: Guides, scene: RenderScene, view: View, cast: Cast, rows: np.ndarray, columns: np.ndarray,
                    start: np.ndarray | None) -> FirstSegments:
    """start: of `follow_paths`, of refractions; None of reflections."""
    eye, rays = view_rays_at(view, columns + 0.5, rows + 0.5)
    position, normal = guides.position[rows, columns], facing(guides.normal[rows, columns], rays)
    triangle = CameraRays(scene, view).closest(rays).triangle
    side, is_known = side_normals(scene, triangle, rays), triangle >= 0
    normal = np.where(is_known[:, None], bent_to_reflect(normal, side, rays), normal)
    _, inside, texel = surface(scene, triangle, position, rays)
    inside &= is_known
    if start is None:
        lift = LIFT * first_reach(position, eye)[:, None]
        gain = mirrored_by_plates(scene, cast, position, lift, rays, normal, texel, inside)
        return FirstSegments(position, reflected(rays, normal), eye, np.where(is_known[:, None], gain, 1))
    facet = rough_facets(rays, normal, texel[:, ROUGHNESS], start, 0)
    direction = refracted(rays, facet, texel[:, IOR], inside)
    is_lost, enters = lost(direction, facet, side) & is_known, ~inside
    if guides.straight is not None:
        is_straight = guides.straight[rows, columns]
        direction = np.where(is_straight[:, None], rays, direction)
        is_lost, enters = is_lost & ~is_straight, enters & ~is_straight
    return FirstSegments(position, direction, eye, ~is_lost[:, None], np.where(enters[:, None], normal, 0))
