# SPDX-License-Identifier: GPL-3.0-or-later
"""Direct light at pixels: closed forms at every pixel, shadows at probes."""
from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from ...progress import part, standing_still
from ..effort import Effort
from ..hit_surfaces import HitSurfaces
from ..probes import SMOOTHED, Around, ComputeLight, Differ, Filter, Light, Probes, varies
from ..sampling import r2_starts
from .direct_light import DirectLight, LobeVisibility
from .footprints import footprints, offsets_within, smooth_steps

SHADOW_RAYS, EMITTER_RAYS = 16, 6  # of a pixel, and of these to one emitter at most
PENUMBRA = 0.3                     # difference of visibility that is no noise of one penumbra
DECISIVE = 4                       # rays from a pixel to an emitter, from which on they tell a penumbra from an edge
MORE, ENOUGH = 2, 12               # times as many rays in penumbras, unless there are so many
LINE, AREA = 0.4, 0.8              # mean disagreement of such rays around an edge, and within a penumbra


def direct_light(direct: DirectLight, probes: Probes, surfaces: HitSurfaces, *rest) -> list[Tensor]:
    """As `_direct_light`, on each group of surfaces that of the lights which light it."""
    if surfaces.group is None:
        return _direct_light(direct, probes, surfaces, *rest)
    lobes = [torch.zeros_like(surfaces.position) for _ in range(3)]
    for group in np.unique(surfaces.group).tolist():
        is_of_group = torch.from_numpy(surfaces.group == group).to(direct.device)[..., None]
        for whole, some in zip(lobes, _direct_light(direct.reaching(group), probes, surfaces, *rest), strict=True):
            whole += some * is_of_group
    return lobes


def _direct_light(direct: DirectLight, probes: Probes, surfaces: HitSurfaces, sky: Tensor, glossy_sky: Tensor,
                  refracted: Tensor | None, effort: Effort) -> list[Tensor]:
    """Radiance (h, W, 3) that a white diffuse, glossy and transmissive lobe send to the viewer.

    sky, glossy_sky: (h, W, 3) visibility of the sky, as gather rays have found it. refracted: (h, W, 3) what the
    transmissive lobe shows, where refractions were followed.
    """
    with part(0.0, 2 / 3):
        emitters, glossy_emitters = _shadows(direct, probes, surfaces, effort)
    with part(2 / 3, 1.0):
        sky_behind = torch.full_like(surfaces.coverage, refracted is None)
        visibility = LobeVisibility(sky, emitters, glossy_sky, glossy_emitters, sky_behind)
        row = surfaces.is_covered.flatten().nonzero()[:, 0]
        visibility = LobeVisibility(*(x.flatten(0, 1)[row] for x in visibility))
        footprint = [footprints(surfaces).flatten(0, 1)[row]] if effort.edges else []
        shown = direct.lobes(*(x[row] for x in surfaces.lobe_points), visibility, *footprint)
        lobes = [torch.zeros_like(surfaces.position) for _ in shown]
        for lobe, radiance in zip(lobes, shown, strict=True):
            lobe.view(-1, 3)[row] = radiance
        add_sheen(lobes[0], direct, surfaces, emitters)
        if refracted is not None:
            lobes[2] = refracted
        return lobes


def add_sheen(diffuse: Tensor, direct: DirectLight, surfaces: HitSurfaces, visibility: Tensor) -> None:
    """Give the share of the diffuse lobe (h, W, 3) that is of a sheen the light that the sheen sends on, in place.

    visibility: (h, W, 3), of the emitters. The sky's light is as a matte surface has it.
    """
    if surfaces.sheen is None or not len(direct.emitters):
        return
    share, stretch, lean = surfaces.sheen.split([3, 1, 3], -1)
    at = (share.any(-1) & surfaces.is_covered[..., 0]).nonzero().unbind(1)
    of_diffuse, of_sheen = direct.sheen(surfaces.position[at], surfaces.normal[at], stretch[at][:, 0], lean[at])
    diffuse[at] += share[at] * (of_sheen - of_diffuse) * visibility[at]


def shadow_grid(emitters: int) -> int:
    """Pixels between probes at which shadows of so many emitters are traced."""
    return next((grid for most, grid in ((SHADOW_RAYS, 1), (4 * SHADOW_RAYS, 2)) if emitters <= most), 4)


def _shadows(direct: DirectLight, probes: Probes, surfaces: HitSurfaces, effort: Effort) -> tuple[Tensor, Tensor]:
    """(h, W, 3) visibility of the emitters for the diffuse and the glossy lobe."""
    of_pixel = max(effort.of(SHADOW_RAYS), SHADOW_RAYS)
    rays = max(min(of_pixel // max(len(direct.emitters), 1), effort.of(EMITTER_RAYS)), 1)
    grid = min(max(shadow_grid(len(direct.emitters)), effort.shadow_grid), probes.grid)
    fine = Probes(*probes.picture, grid, grid, probes.separation)
    trace, steps = partial(_trace_shadows, direct), smooth_steps(surfaces)
    curved = surfaces.position[..., :0] if direct.curved is None else direct.curved.at(surfaces)
    gloss = curved, -surfaces.rays, surfaces.roughness, surfaces.f0
    if rays < DECISIVE:
        filters = Filter(1), Filter(2, _difference)
        pictures = fine.interpolate(partial(trace, rays), grid * steps, *gloss, where=surfaces.is_covered,
                                    filters=filters[:effort.smoothings])
    else:
        pictures = _trace_penumbras(fine, probes.grid, trace, rays, steps, *gloss)
        with standing_still():
            pictures = _smooth_penumbras(fine, pictures)
    return pictures["diffuse"], pictures["glossy"]


def _trace_penumbras(fine: Probes, coarse_grid: int, trace: Callable[..., Light], rays: int, steps: Tensor,
                     *gloss: Tensor) -> Light:
    """Visibility by `rays` to each emitter from coarse probes, all over their cells, and by more from fine ones where
    these disagree."""
    covered = fine.picture[2]
    coarse = fine if coarse_grid == fine.grid else Probes(*fine.picture, coarse_grid, fine.grid, fine.separation)
    cell = torch.full_like(steps[..., :1, :1], fine.grid)
    cell[coarse.rows[:, None], coarse.columns] = coarse.grid
    with part(0.0, 0.5):
        pictures = coarse.interpolate(partial(trace, rays), cell * steps, *gloss, where=covered)
    if coarse is fine and rays >= ENOUGH:
        return pictures
    is_penumbra = varies(pictures["disagreement"], coarse.grid)[..., None]
    rays = rays if rays >= ENOUGH else MORE * rays
    with part(0.5, 1.0):
        traced = fine.interpolate(partial(trace, rays), fine.grid * steps, *gloss, where=covered & is_penumbra)
    return {name: torch.where(is_penumbra, traced[name], picture) for name, picture in pictures.items()}


def _smooth_penumbras(probes: Probes, visibility: Light) -> Light:
    """Visibility at all pixels, smoothed where rays to one emitter disagree all around, as they do in a penumbra.

    Where they disagree along a line alone, that is the edge of a shadow, which stays sharp.
    """
    around = probes.interpolate(_known("mean"), visibility["disagreement"], filters=SMOOTHED)["mean"]
    in_penumbra = ((around - LINE) / (AREA - LINE)).clamp(0, 1)
    pictures = visibility | {"is_edge": 1 - in_penumbra}
    return probes.interpolate(_known(*pictures), *pictures.values(), filters=[Filter(1, _difference_at_edges)])


def _known(*names: str) -> ComputeLight:
    """Gives probes what is known at their pixels."""
    return lambda x, n, number, *pictures: dict(zip(names, pictures, strict=True))


def _difference(visibility: Tensor, around: Around) -> Differ:
    """Difference of the diffuse lobe's, which comes first."""
    diffuse = visibility[:, :3]
    return lambda row, number: (diffuse[number] - diffuse[row, None]).abs().amax(-1) / PENUMBRA


def _difference_at_edges(visibility: Tensor, around: Around) -> Differ:
    """The same, and none within penumbras; how far a probe is at an edge comes last."""
    is_edge, differ = visibility[:, -1], _difference(visibility, around)
    return lambda row, number: differ(row, number) * (is_edge[number] + is_edge[row, None]) / 2


def _trace_shadows(direct: DirectLight, rays: int, x: Tensor, n: Tensor, number: Tensor, steps: Tensor,
                   curved: Tensor, *gloss: Tensor) -> dict[str, Tensor]:
    """Visibility of the emitters from points, and how far rays disagree, by so many rays to each.

    steps: (P, 3, 3), across the pixel in which the rays start, and up (smooth_steps). curved: (P, 6), as of
    CurvedFaces, or (P, 0).
    """
    numbers = rays * number[:, None] + torch.arange(rays, device=x.device)
    start = r2_starts(numbers.flatten()).unflatten(0, numbers.shape)
    offset = F.pad(offsets_within(x.device), (0, 1), value=1.0)
    origin = x[:, None] + offset[numbers % len(offset)] @ steps
    origin = torch.cat([origin, curved[:, None].expand(-1, rays, -1)], 2)
    found = direct.emitter_visibility(x, n, origin, start, *gloss)
    return dict(zip(("diffuse", "glossy", "disagreement"), found, strict=True))
