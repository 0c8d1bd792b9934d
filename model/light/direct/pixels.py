# SPDX-License-Identifier: GPL-3.0-or-later
"""Direct light at pixels: closed forms at every pixel, shadows at probes."""
from __future__ import annotations

from functools import partial

import numpy as np
import torch
from torch import Tensor

from ...progress import part
from ..effort import Effort
from ..hit_surfaces import HitSurfaces
from ..probes import SMOOTH, Probes
from ..sampling import r2_starts
from .direct_light import DirectLight, LobeVisibility
from .footprints import footprints

SHADOW_RAYS, EMITTER_RAYS = 16, 6  # of a pixel, and of these to one emitter at most
PENUMBRA = 0.3                     # difference of visibility that is no noise of one penumbra


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
                  refracted: Tensor | None, effort: Effort, is_traced: bool) -> list[Tensor]:
    """Radiance (h, W, 3) that a white diffuse, glossy and transmissive lobe send to the viewer.

    sky, glossy_sky: (h, W, 3) visibility of the sky, as gather rays have found it. refracted: (h, W, 3) what the
    transmissive lobe shows, where refractions were followed. Beside traced light, which has sharp shadows and
    highlights, both are coarser.
    """
    with part(0.0, 2 / 3):
        emitters, glossy_emitters = _shadows(direct, probes, surfaces, effort, is_sharp=not is_traced)
    with part(2 / 3, 1.0):
        sky_behind = torch.full_like(surfaces.coverage, refracted is None)
        visibility = LobeVisibility(sky, emitters, glossy_sky, glossy_emitters, sky_behind)
        visibility = LobeVisibility(*(x.flatten(0, 1) for x in visibility))
        footprint = [footprints(surfaces).flatten(0, 1)] if effort.edges and not is_traced else []
        lobes = direct.lobes(*surfaces.lobe_points, visibility, *footprint)
        lobes = [lobe.view_as(surfaces.position) * surfaces.is_covered for lobe in lobes]
        if refracted is not None:
            lobes[2] = refracted
        return lobes


def shadow_grid(emitters: int) -> int:
    """Pixels between probes at which shadows of so many emitters are traced."""
    return next((grid for most, grid in ((SHADOW_RAYS, 1), (4 * SHADOW_RAYS, 2)) if emitters <= most), 4)


def _shadows(direct: DirectLight, probes: Probes, surfaces: HitSurfaces, effort: Effort,
             is_sharp: bool) -> tuple[Tensor, Tensor]:
    """(h, W, 3) visibility of the emitters for the diffuse and the glossy lobe."""
    grid = probes.grid
    if is_sharp:
        grid = min(max(shadow_grid(len(direct.emitters)), effort.shadow_grid), grid)
    pictures = Probes(*probes.picture, grid, grid, probes.separation).interpolate(
        partial(_trace_shadows, direct, effort), -surfaces.rays, surfaces.roughness, surfaces.f0,
        filters=SMOOTH[:effort.smoothings], difference=_difference)
    return pictures["diffuse"], pictures["glossy"]


def _difference(visibility: Tensor, other: Tensor) -> Tensor:
    """(...,) of RGB (..., 3)."""
    return (visibility - other).abs().amax(-1) / PENUMBRA


def _trace_shadows(direct: DirectLight, effort: Effort, x: Tensor, n: Tensor, number: Tensor,
                   *gloss: Tensor) -> dict[str, Tensor]:
    """Visibility of the emitters from points, by some rays to each: SHADOW_RAYS in all."""
    count = max(min(SHADOW_RAYS // max(len(direct.emitters), 1), effort.of(EMITTER_RAYS)), 1)
    start = torch.stack([r2_starts(count * number + k) for k in range(count)], 1)
    return dict(zip(("diffuse", "glossy"), direct.emitter_visibility(x, n, start, *gloss)))
