# SPDX-License-Identifier: GPL-3.0-or-later
"""Indirect light between the surfaces: radiosity with visibility by rays.

Form factors between patches (Goral et al. 1984) and the light that arrives at a point (final gather, Reichert 1992, "A
two-pass radiosity method") are estimated by rays. Direct light on the patches comes from DirectLight; light through
glass is found by the same rays and by photons.
"""
from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from ...progress import part
from ...scene import RenderScene
from ...scene_rays import scene_rays
from ...surface_kinds import BENDING
from ..caustics.photon_map import PhotonMap
from ..caustics.photons import Photons, trace_photons
from ..direct.direct_light import DirectLight
from ..effort import FULL, Effort
from ..fresnel import schlick
from ..sampling import cosine_directions, ggx_directions, hashed_starts, r2_starts
from .bright_patches import importance_by_arrival, importance_by_power
from .final_gather import LIFT, Gathered, GatherScene
from .openness import Openness
from .patches import PATCHES, STEEP, make_patches

BOUNCES = 3       # between patches, before the last one at the point: together as many as Cycles' diffuse ones
GLOSSY_BOUNCES = 2  # besides: more add next to nothing
PATCH_RAYS = 64   # from each side of a patch
PATCH_AIMED = 32  # rays more towards bright patches
POINTS = 4        # of a patch, at which emitters light it and from which its rays start
SHADOW_RAYS = 1 << 19  # from all patches to emitters; fewer points where there are many, but one at least
SKY_RAYS = 64     # from each side of a patch, to the sky
RAYS = 24         # from a point
AIMED = 12        # rays more towards bright patches
GLOSSY_RAYS = 16  # from a point, within its glossy lobe
PHOTONS = 1 << 16  # from emitters to glass


class GlossyLight(NamedTuple):
    """Light that white glossy surfaces send towards the viewer at P points."""

    complete: Tensor               # (P, 3) radiance of all indirect light
    bounced: Tensor | None = None  # (P, 3) what of it has bounced diffusely before, where light was traced
    missed: Tensor | None = None   # (P, 3) what of the rest Cycles' traced light leaves out
    sky: Tensor | None = None      # (P, 3) visibility of the sky in the lobe


class Radiosity:
    """Radiance that leaves the patches of a normalised scene after all bounces, in the units of its DirectLight."""

    def __init__(self, scene: RenderScene, direct: DirectLight, effort: Effort = FULL):
        emitters = direct.emitters.near()
        openness = None
        if effort.walls:
            openness = Openness(scene, direct.occluders, direct.device)
        patches = make_patches(scene, emitters, effort.patches, openness)
        with part(0.0, 0.2):
            self.gather_scene = GatherScene(scene, patches, direct)
        count = min(max(SHADOW_RAYS // (2 * PATCHES * max(len(emitters.power_share), 1)), 1), effort.of(POINTS))
        # All fronts, then all backs, here and below; the points of a patch follow each other.
        points, normals = patches.points(count)
        x, n = (torch.cat(sides).flatten(0, 1).to(direct.device) for sides in ((points, points), (normals, -normals)))
        diffuse, metal, layer = patches.albedo.repeat(2, 1).to(direct.device).split(3, dim=1)
        f0, roughness = patches.layer.repeat(2, 1).to(direct.device).repeat_interleave(count, 0).unbind(1)
        area = patches.vector.norm(dim=-1).to(direct.device)
        size = patches.weight.repeat(2).to(direct.device)
        with part(0.2, 0.4):
            visibility = direct.visibility(x, n, hashed_starts(x, 2), effort.of(SKY_RAYS) // count)
        with part(0.4, 0.5):
            self.caustics, caustic_light = self._trace_caustics(scene, direct, area, effort.of(PHOTONS))
        with part(0.5, 0.6):
            white, slanting = (light.view(-1, count, 3) for light in direct.diffuse_and_layer(
                x + LIFT * n, n, visibility, f0, roughness))
            first = (diffuse + STEEP * metal)[:, None] * white + layer[:, None] * slanting
        self.gather_scene.aim(importance_by_power(first.mean(1), size))
        with part(0.6, 1.0):
            start = hashed_starts(x, 2)
            gathered = self.gather_scene.gather(x, n, cosine_directions(n, effort.of(PATCH_RAYS) // count, start),
                                                effort.of(PATCH_AIMED) // count, start)
            weight = self.gather_scene.reliability(gathered, count)
            gathered = gathered.merged(weight)
        first, glossy = (weight[..., None] * first).mean(1), metal + layer
        through = (diffuse + glossy) * (gathered.through + caustic_light)
        glossily, diffusely = _bounce(gathered, first + through, diffuse, glossy)
        self.bounced_before = through + diffusely  # (sides, 3) what of it has bounced diffusely, or come through glass
        self.leaving = first + self.bounced_before + glossily  # (sides, 3) radiance that leaves all sides of patches
        self.gather_scene.aim(importance_by_arrival(self.leaving, size, gathered.side, gathered.share))

    def _trace_caustics(self, scene: RenderScene, direct: DirectLight, area: Tensor,
                        count: int) -> tuple[PhotonMap, Tensor]:
        """The photons that glass sends to surfaces, of `count` from emitters.

        And the radiance (sides, 3) that white diffuse patches of an `area` (S,) send on by them.
        """
        flux = area.new_zeros(2 * len(area) + 1, 3)
        if not len(scene_rays(scene).rows(BENDING)) or not len(direct.emitters):
            return PhotonMap.empty(area), flux[:-1]
        photons = Photons(*(torch.from_numpy(x).to(area.device) for x in trace_photons(scene, direct, count)))
        side = self.gather_scene.hit_sides(photons.triangle, photons.weights, photons.direction)
        flux.index_add_(0, side, photons.flux)
        return (PhotonMap(photons.position, photons.normal, photons.flux),
                flux[:-1] / (math.pi * area.clamp_min(1e-20).repeat(2)[:, None]))

    def indirect(self, position: Tensor, normal: Tensor, number: Tensor | None = None, effort: Effort = FULL) -> Tensor:
        """(P, 3) indirect light, as radiance leaving a white diffuse surface at points (P, 3) with normals (P, 3).

        number: (P,), which consecutive neighbours should have, so that their rays fill each other's gaps.
        """
        return self.indirect_and_sky(position, normal, number, effort, with_sky=False)[0]

    def indirect_and_sky(self, position: Tensor, normal: Tensor, number: Tensor | None = None, effort: Effort = FULL,
                         with_sky: bool = True) -> tuple[Tensor, ...]:
        """The same, and by the same rays the visibility of the sky (P, 3) for a diffuse surface."""
        number = torch.arange(len(position), device=position.device) if number is None else number
        start = r2_starts(number)
        gathered = self.gather_scene.gather(position, normal, cosine_directions(normal, effort.of_probe(RAYS), start),
                                            effort.of_probe(AIMED), start)
        light = gathered.through + self.caustics.radiance(position, normal) + gathered.radiance(self.leaving)
        return (light, gathered.sky_visibility(self.gather_scene.environment)) if with_sky else (light,)

    def glossy(self, position: Tensor, normal: Tensor, outgoing: Tensor, roughness: Tensor, f0: Tensor,
               diffuse_ratio: Tensor, number: Tensor, effort: Effort = FULL, traced: bool = False,
               with_sky: bool = True) -> GlossyLight:
        """Indirect light that white glossy surfaces at points (P, 3) send towards `outgoing` (P, 3).

        roughness (perceptual), f0: (P,); diffuse_ratio: (P,), albedo of the diffuse lobe over that of the glossy one;
        number: (P,) as above. traced: whether Cycles traced light. It follows as many paths from a surface as its
        glossy lobe has a share in each direction, so it leaves out as much of that lobe's light as it traces of the
        diffuse one's, by the albedos of both.
        """
        direction, weight, cosine, density = ggx_directions(normal, outgoing, roughness, effort.of_probe(GLOSSY_RAYS),
                                                            r2_starts(number))
        gathered = self.gather_scene.gather(position, normal, direction, with_media=False)
        weight = weight * schlick(f0[:, None], cosine)
        weight = weight / weight.mean(1, keepdim=True).clamp_min(1e-6)
        complete, bounced, missed = gathered.radiance(self.leaving, weight), None, None
        if traced:
            diffuse = diffuse_ratio[:, None] * (direction @ normal[..., None])[..., 0].clamp_min(0) / math.pi
            share = diffuse / (diffuse + weight * density).clamp_min(1e-6)
            bounced = gathered.radiance(self.bounced_before, weight)
            missed = gathered.radiance(self.leaving - self.bounced_before, weight * share)
        sky = gathered.sky_visibility(self.gather_scene.environment, weight) if with_sky else None
        return GlossyLight(complete, bounced, missed, sky)


def _bounce(gathered: Gathered, light: Tensor, diffuse: Tensor, glossy: Tensor) -> tuple[Tensor, Tensor]:
    """What becomes of `light` (sides, 3) that leaves the patches, by as many bounces as Cycles allows: (sides, 3) each.

    Separately by glossy bounces alone, which Cycles' traced light follows from mirrors, and by all others.
    """
    after = {(0, 0): light}  # by number of diffuse and of glossy bounces
    for count in range(1, BOUNCES + GLOSSY_BOUNCES + 1):
        pairs = [(d, count - d) for d in range(count + 1) if d <= BOUNCES and count - d <= GLOSSY_BOUNCES]
        before = [pair for pair in after if sum(pair) == count - 1]
        arriving = dict(zip(before, gathered.radiance(torch.cat([after[pair] for pair in before], 1)).split(3, 1)))
        for d, g in pairs:
            after[d, g] = sum(albedo * arriving[pair] for albedo, pair in ((diffuse, (d - 1, g)), (glossy, (d, g - 1)))
                              if pair in arriving)
    return (sum(after[0, g] for g in range(1, GLOSSY_BOUNCES + 1)),
            sum(bounced for (d, _), bounced in after.items() if d))
