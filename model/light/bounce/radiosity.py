# SPDX-License-Identifier: GPL-3.0-or-later
"""Indirect light between the surfaces: radiosity with visibility by rays.

Form factors between patches (Goral et al. 1984) and the light that arrives at a point (final gather, Reichert 1992, "A
two-pass radiosity method") are estimated by rays. Direct light on the patches comes from DirectLight; light through
glass is found by the same rays and by photons.
"""
from __future__ import annotations

import math
from functools import partial
from typing import NamedTuple

import torch
from torch import Tensor

from ...compute.inference import current_pieces
from ...compute.threads import shared
from ...material.reflectance import blurred
from ...progress import part
from ...scene import ANY, RenderScene
from ...scene_rays import scene_rays
from ...surface_kinds import BENDING, Ray
from ..caustics.photon_map import PhotonMap
from ..caustics.photons import Photons, lit_surfaces, trace_photons
from ..direct.direct_light import DirectLight
from ..direct.environment_light import LIFT
from ..effort import FULL, Effort
from ..fresnel import reflectance
from ..probes import CHUNK
from ..sampling import ggx_directions, hashed_starts, r2_starts
from .bounces import Bounces, bounce, spread_through, translucent_chains
from .bright_patches import importance_by_arrival, importance_by_power
from .final_gather import Gathered, GatherScene
from .openness import Openness
from .patch_layers import PatchLayers
from .patch_lobes import PatchLobes
from .patch_points import PatchPoints, patch_points
from .patches import PATCHES, STEEP, Patches, make_patches

PATCH_RAYS = 16   # from each side of a patch
PATCH_AIMED = 8   # rays more towards bright patches
SKY_RAYS = 16     # from each side of a patch, to the sky
SHADOW_RAYS = 1 << 22  # from all patches to emitters; there are fewer patches where these are many
RAYS = 48         # from a point
AIMED = 24        # rays more towards bright patches
MOST_MORE = 4     # factor on both in small pictures, at most
GLOSSY_RAYS = 16  # from a point, within its glossy lobe
PHOTONS = 1 << 17  # from emitters to glass
THROUGH_GLASS = 3  # bounces that light has after a surface, and both sides of glass


class DiffuseLight(NamedTuple):
    """Light that white diffuse surfaces send on at P points."""

    indirect: Tensor             # (P, 3) radiance
    # (P, 3) the same of fire and of surfaces that glow, which traced light contains; None without either
    fire: Tensor | None
    sky: Tensor | None           # (P, 3) visibility of the sky
    noise: Tensor                # (P, 1) of the grey of `indirect`: as large as its error, of either sign


class GlossyLight(NamedTuple):
    """Light that white glossy surfaces send towards the viewer at P points."""

    complete: Tensor               # (P, 3) radiance of all indirect light
    further: Tensor                # (P, 3) what their diffuse lobes have besides, of light that bounced once more
    bounced: Tensor | None = None  # (P, 3) what of it has bounced diffusely before, where light was traced
    missed: Tensor | None = None   # (P, 3) what of the rest Cycles' traced light leaves out
    sky: Tensor | None = None      # (P, 3) visibility of the sky in the lobe
    highlights: Tensor | None = None  # (P, 3) what of all is lamps in polished metal


class Radiosity:
    """Radiance that leaves the patches of a normalised scene after all bounces, in the units of its DirectLight."""

    def __init__(self, scene: RenderScene, direct: DirectLight, effort: Effort = FULL):
        with part(0.0, 0.3):
            (patches, points, self.gather_scene), (photons, self.caustics) = shared(
                lambda make: make(), (partial(_make_patches, scene, direct, effort),
                                      partial(_trace_caustics, scene, direct, effort)), device=direct.device)
        # All fronts, then all backs, here and below.
        x, normals, n, up = (torch.cat(sides).to(direct.device) for sides in points.on_both_sides())
        albedo, of_layer = (torch.cat(sides).to(direct.device) for sides in (
            (patches.albedo, patches.back_albedo), (patches.layer, patches.back_layer)))
        diffuse, metal, layer = albedo.split(3, dim=1)
        if not scene.has_caustics["reflective"]:
            metal = layer = torch.zeros_like(diffuse)
        translucent = patches.translucent.repeat(2, 1).to(direct.device) if patches.translucent.any() else None
        lit = partial(spread_through, translucent)
        f0, roughness = of_layer[:, 0], blurred(of_layer[:, 1])
        area = patches.vector.norm(dim=-1).to(direct.device)
        size = patches.weight.repeat(2).to(direct.device)
        self._most = Bounces.of(scene)
        group = torch.from_numpy(patches.group).repeat(2)
        with part(0.3, 0.5):
            lights = self._light_by_bounces(direct, x, n, (normals, up), f0, roughness, group, effort.of(SKY_RAYS))
        firsts, glossy_firsts = {}, {}  # (sides, 3), the latter a part of the former
        for most, (white, slanting, _) in lights.items():
            glossy_firsts[most] = STEEP * metal * white + layer * slanting
            firsts[most] = diffuse * lit(white) + glossy_firsts[most]
        glow = patches.glow.repeat(2, 1).to(direct.device)
        self.glow = glow if glow.any() else None
        self.gather_scene.aim(importance_by_power(sum(firsts.values()) + glow, size))
        if (metal + layer).any():
            lobes = _lobes(lights, metal, layer, f0, roughness, normals)
            glossily = sum(glossy_firsts.values()).mean(1) / sum(firsts.values()).mean(1).clamp_min(1e-20)
            even = (1 - lobes.concentration) * glossily * layer.mean(1) / (metal + layer).mean(1).clamp_min(1e-9)
            self.gather_scene.spread(lobes, PatchLayers(*of_layer.unbind(1), 1 - glossily, even))
        with part(0.5, 1.0):
            gathered = self._exchanged(x, n, normals, effort)
            fire = self._with_glow(gathered.fire, gathered)
        glossy = metal + layer
        through = (diffuse + glossy) * lit(gathered.through() + self._of_photons(photons, area))
        # (sides, 3) radiance that leaves all sides of patches, and what of it has bounced diffusely, or through glass;
        # and what has bounced diffusely once more
        self.leaving = self.bounced_before = self._bounced_last = self._of_lobes = torch.zeros_like(through)
        for most in firsts:
            first, of_lobes = firsts[most], glossy_firsts[most]
            if fire is not None and most == ANY:
                first = first + (diffuse + glossy) * lit(fire)
            before = through if most == ANY else torch.zeros_like(through)
            most = self._most.at_most(most)
            glossily, diffusely, last = bounce(gathered, first + before, of_lobes, diffuse, glossy, translucent, most)
            bounced_before = before + diffusely
            self.bounced_before = self.bounced_before + bounced_before
            if translucent is not None:
                chains = translucent_chains(gathered, first, diffuse * translucent, most)
                self.bounced_before = self.bounced_before - chains
            self.leaving = self.leaving + (first + bounced_before + glossily)
            self._of_lobes, self._bounced_last = self._of_lobes + of_lobes, self._bounced_last + last
        self.gather_scene.aim(importance_by_arrival(self.leaving, size, gathered.side, gathered.share))
        self.gather_scene.guide(x, n, gathered, self.leaving)

    def _light_by_bounces(self, direct: DirectLight, x: Tensor, n: Tensor, curved: tuple[Tensor, Tensor], f0: Tensor,
                          roughness: Tensor, group: Tensor, sky_rays: int) -> dict[int, tuple[Tensor, ...]]:
        """DirectLight.diffuse_and_layer at points (P, 3) of groups (P,), by the most bounces that light has.

        curved: as of DirectLight.visibility.
        """
        bounces = sorted(direct.bounces - {0})  # what bounces nowhere is seen where it falls
        lights = {most: tuple(torch.zeros_like(x) for _ in range(3)) for most in bounces}
        kinds = [(most, some) for most in bounces for some in group.unique().tolist()]
        for i, (most, some) in enumerate(kinds):
            light = direct.reaching(some, lambda bounces, most=most: bounces == most)
            rows = slice(None) if (group == some).all() else (group == some).nonzero()[:, 0].to(x.device)
            with part(i / len(kinds), (i + 0.5) / len(kinds)):
                visibility = light.visibility(x[rows], n[rows], hashed_starts(x[rows], 2), sky_rays,
                                              *(some[rows] for some in curved))
            with part((i + 0.5) / len(kinds), (i + 1) / len(kinds)):
                found = light.diffuse_and_layer(x[rows] + LIFT * n[rows], n[rows], visibility, f0[rows],
                                                roughness[rows])
                for of_all, of_rows in zip(lights[most], found, strict=True):
                    of_all[rows] = of_rows
        return lights

    def _of_photons(self, photons: Photons | None, area: Tensor) -> Tensor:
        """(sides, 3) radiance that white diffuse patches of an `area` (S,) send on by photons."""
        flux = area.new_zeros(2 * len(area) + 1, 3)
        if photons is not None:
            flux.index_add_(0, self.gather_scene.hit_sides(photons.triangle, photons.weights, photons.direction),
                            photons.flux)
        return flux[:-1] / (math.pi * area.clamp_min(1e-20).repeat(2)[:, None])

    def _exchanged(self, x: Tensor, n: Tensor, normals: Tensor, effort: Effort) -> Gathered:
        """What rays from points of patches (sides, 3) hit, of unit normals and, for shading, n (sides, 3)."""
        def gather(x: Tensor, n: Tensor, normals: Tensor, start: Tensor) -> Gathered:
            gathered = self.gather_scene.diffuse(x, n, start, effort.of(PATCH_RAYS), effort.of(PATCH_AIMED))
            direction = gathered.direction
            gathered.share[:, :direction.shape[1]] *= (direction @ normals[..., None])[..., 0] > 0
            return gathered

        of_all, chunk = (x, n, normals, hashed_starts(x, 2)), current_pieces().limit(CHUNK)
        return Gathered.joined(shared(gather, *(values.split(chunk) for values in of_all)))

    def diffuse(self, position: Tensor, normal: Tensor, number: Tensor | None = None, effort: Effort = FULL,
                with_sky: bool = True) -> DiffuseLight:
        """Light of white diffuse surfaces at points (P, 3) with normals (P, 3).

        number: (P,), which consecutive neighbours should have, so that their rays fill each other's gaps.
        """
        number = torch.arange(len(position), device=position.device) if number is None else number
        gathered = self._gathered(position, normal, number, effort)
        light = gathered.with_lobes(self.leaving, self._of_lobes)
        light = light + gathered.through() + self.caustics.radiance(position, normal)
        if not self._most.diffusely:
            light = torch.zeros_like(light)
        sky = gathered.sky_visibility(self.gather_scene.environments[Ray.DIFFUSE]) if with_sky else None
        return DiffuseLight(light, self._with_glow(gathered.fire, gathered), sky, gathered.noise(self.leaving))

    def _gathered(self, position: Tensor, normal: Tensor, number: Tensor, effort: Effort) -> Gathered:
        """What rays from points (P, 3) of matte surfaces hit; arguments as of `diffuse`."""
        rays, aimed = (effort.of_probe(count, MOST_MORE) for count in (RAYS, AIMED))
        return self.gather_scene.diffuse(position, normal, r2_starts(number), rays, aimed)

    def _with_glow(self, light: Tensor | None, gathered: Gathered, weight: Tensor | None = None) -> Tensor | None:
        """(P, 3) `light` and that of surfaces which glow; None if there is neither."""
        if self.glow is None:
            return light
        glow = gathered.radiance(self.glow, weight)
        return glow if light is None else light + glow

    def behind(self, position: Tensor, normal: Tensor, number: Tensor, effort: Effort = FULL) -> dict[str, Tensor]:
        """(P, 3) as of `diffuse`: "all" light, and what of it has "bounced" before, which traced light has not."""
        gathered = self._gathered(position, normal, number, effort)
        other = gathered.through() + self.caustics.radiance(position, normal)
        other = other + gathered.radiance(self._bounced_last)
        return {"all": self._with_glow(gathered.with_lobes(self.leaving, self._of_lobes) + other, gathered),
                "bounced": gathered.radiance(self.bounced_before) + other}

    def glossy(self, position: Tensor, normal: Tensor, outgoing: Tensor, roughness: Tensor, f0: Tensor,
               diffuse_ratio: Tensor, number: Tensor, effort: Effort = FULL, traced: bool = False,
               with_sky: bool = True) -> GlossyLight:
        """Indirect light that white glossy surfaces at points (P, 3) send towards `outgoing` (P, 3).

        roughness (perceptual), f0: (P,); diffuse_ratio: (P,), albedo of the diffuse lobe over that of the glossy one;
        number: (P,) as above. traced: whether Cycles traced light. It follows as many paths from a surface as its
        glossy lobe has a share in each direction, so it leaves out as much of that lobe's light as it traces of the
        diffuse one's, by the albedos of both. Such paths may bounce diffusely once more than those from a diffuse lobe.
        """
        direction, weight, cosine, density = ggx_directions(normal, outgoing, roughness, effort.of_probe(GLOSSY_RAYS),
                                                            r2_starts(number))
        gathered = self.gather_scene.glossy(position, normal, direction, roughness)
        weight = weight * reflectance(f0[:, None], cosine)
        weight = weight / weight.mean(1, keepdim=True).clamp_min(1e-6)
        if not self._most.glossily:
            weight = torch.zeros_like(weight)
        skies, highlights = gathered.specular(weight)
        diffuse = diffuse_ratio[:, None] * (direction @ normal[..., None])[..., 0].clamp_min(0) / math.pi
        share = diffuse / (diffuse + weight * density).clamp_min(1e-6)  # of paths from the diffuse lobe
        last = gathered.radiance(self._bounced_last, weight * (1 - share))
        to_diffuse = (weight * share).mean(1, keepdim=True)
        further = last * to_diffuse / (weight.mean(1, keepdim=True) - to_diffuse).clamp_min(1e-6)
        complete = gathered.with_lobes(self.leaving, self._of_lobes, weight) + last + skies + highlights
        complete = self._with_glow(complete, gathered, weight)
        bounced = missed = None
        if traced:
            bounced = gathered.radiance(self.bounced_before, weight) + last
            missed = (gathered.with_lobes(self.leaving - self.bounced_before, self._of_lobes, weight * share)
                      + sum(gathered.specular(weight * share)))
            if not self._most.diffusely:  # what is traced is all there is
                bounced, missed = torch.zeros_like(bounced), torch.zeros_like(missed)
        sky = gathered.sky_visibility(self.gather_scene.environments[Ray.GLOSSY], weight) if with_sky else None
        return GlossyLight(complete, further, bounced, missed, sky, highlights)


def _make_patches(scene: RenderScene, direct: DirectLight,
                  effort: Effort) -> tuple[Patches, PatchPoints, GatherScene]:
    emitters = direct.emitters.near()
    openness = Openness(scene, direct.occluders, direct.device) if effort.walls else None
    share = min(SHADOW_RAYS / (2 * PATCHES * max(len(emitters.power_share), 1)), effort.patches)
    patches = make_patches(scene, emitters, share, openness)
    return patches, patch_points(patches, openness), GatherScene(scene, patches, direct)


def _trace_caustics(scene: RenderScene, direct: DirectLight, effort: Effort) -> tuple[Photons | None, PhotonMap]:
    """The photons that glass sends to surfaces, as tensors, and their density."""
    direct, like = direct.reaching(bounces=lambda bounces: bounces >= THROUGH_GLASS), direct.emitters.radiance
    is_bent = scene.has_caustics["refractive"] and len(scene_rays(scene).rows(BENDING, Ray.DIFFUSE))
    if not is_bent or not len(direct.emitters):
        return None, PhotonMap.empty(like)
    photons = Photons(*(torch.from_numpy(x).to(like.device)
                        for x in trace_photons(scene, direct, effort.of(PHOTONS))))
    return photons, PhotonMap(photons.position, photons.normal, photons.flux, lit_surfaces(scene), effort.photon_grids)


def _lobes(lights: dict[int, tuple[Tensor, ...]], metal: Tensor, layer: Tensor, f0: Tensor, roughness: Tensor,
           normals: Tensor) -> PatchLobes:
    """The lobes of sides with albedos and normals (sides, 3), f0 and roughness (sides,)."""
    light, toward = (sum(kinds) for kinds in list(zip(*lights.values(), strict=True))[1:])
    metal, layer = metal.mean(1), layer.mean(1)
    return PatchLobes(normals, toward / light.mean(1, keepdim=True).clamp_min(1e-20),
                      torch.lerp(f0, torch.ones_like(f0), metal / (metal + layer).clamp_min(1e-9)), roughness)
