# SPDX-License-Identifier: GPL-3.0-or-later
"""Final gather: rays from points to sides of patches, to the sky, and to the sky behind glass."""
from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate

import torch
from torch import Tensor
from torch.nn import functional as F

from ...progress import part
from ...scene import RenderScene
from ...scene_rays import scene_rays
from ...surface_kinds import BENDING, SOLID, STRAIGHT_THROUGH, Kind, Ray
from ..cutouts import Veils
from ..direct.direct_light import DirectLight
from ..direct.environment_light import BLUR, FOG_REACH, LIFT, EnvironmentLight
from ..tensor_rays import TensorRays
from ..vectors import dot
from ..weighted_rows import weighted_rows
from .bright_patches import BrightPatches
from .guide import Guide
from .matte_rays import MatteRays
from .panes import Panes
from .patch_layers import PatchLayers
from .patch_lobes import PatchLobes
from .patches import Patches
from .polished import Mirrored, PolishedMetal

TOUCHING = 1e-3  # network units from a point to the plane of its own face, at most
ALIKE = 0.5      # cosine between normals of a face and for shading, at least
FOG_RAYS = 8  # of a point, along which in-scattering is computed


@dataclass
class Gathered:
    """What R rays from each of P points hit, and A more that were aimed at bright patches.

    Rays of matte points are weighted as MatteRays says.
    """

    direction: Tensor  # (P, R, 3), unit
    side: Tensor       # (P, R + A) row of a patch's front or back among those of all patches; one behind them = none
    share: Tensor      # (P, R + A) share of the radiance from there that arrives, times the weight of the ray
    sky: Tensor        # (P, R, 1) or (P, R, 3) share of the sky's radiance that arrives where nothing is hit
    media: Tensor      # (P, 3) mean radiance of media
    weight: Tensor | None = None  # (P, R) of rays to the sky; None: all count alike
    fire: Tensor | None = None  # (P, 3) mean radiance of fire, which is not in `media`; None without any
    # (M,) numbers among all P (R + A) rays, and (M, 3) the radiance that these see besides, times their weights: the
    # sky behind glass and in polished metal; and lamps in that
    skies: tuple[Tensor, Tensor] | None = None
    highlights: tuple[Tensor, Tensor] | None = None
    tint: Tensor | None = None  # (P, R + A, 3) colour of `share`, whose mean is 1; None where nothing has one
    excess: Tensor | None = None  # (P, R + A) as of PatchLobes; None without any

    @classmethod
    def joined(cls, parts: list[Gathered]) -> Gathered:
        """Of some points and others, but for `highlights`."""
        of_parts = {name: [getattr(some, name) for some in parts] for name in (
            "direction", "side", "share", "sky", "media", "weight", "fire", "tint", "excess")}
        joined = {name: None if some[0] is None else torch.cat(some) for name, some in of_parts.items()}
        if parts[0].skies is not None:
            before = accumulate((some.side.numel() for some in parts), initial=0)
            rays = torch.cat([first + some.skies[0] for first, some in zip(before, parts, strict=False)])
            joined["skies"] = rays, torch.cat([some.skies[1] for some in parts])
        return cls(**joined)

    def through(self) -> Tensor:
        """(P, 3) mean radiance of media, and of the sky behind glass."""
        return self.media + self._mean_of(self.skies)

    def radiance(self, leaving: Tensor, weight: Tensor | None = None) -> Tensor:
        """(P, C) mean of what arrives of the radiance (sides, C) that leaves the patches, RGB any number of times.

        weight: (P, R) of the rays, whose mean is 1.
        """
        share = self.share if weight is None else self.share * weight
        leaving, count = F.pad(leaving, (0, 0, 0, 1)), self.side.shape[1]
        if self.tint is None:
            return weighted_rows(leaving, self.side, share) / count
        colors = [weighted_rows(leaving[:, i::3], self.side, share * self.tint[..., i]) for i in range(3)]
        return torch.stack(colors, -1).flatten(1) / count

    def with_lobes(self, leaving: Tensor, of_lobes: Tensor, weight: Tensor | None = None) -> Tensor:
        """The same of `leaving`, of which `of_lobes` (sides, C) goes the way of PatchLobes."""
        arriving = self.radiance(leaving, weight)
        if self.excess is None:
            return arriving
        return arriving + self.radiance(of_lobes, self.excess if weight is None else self.excess * weight)

    def specular(self, weight: Tensor) -> tuple[Tensor, Tensor]:
        """(P, 3) mean radiance of `skies`, and of `highlights`; weight as above."""
        return self._mean_of(self.skies, weight), self._mean_of(self.highlights, weight)

    def _mean_of(self, seen: tuple[Tensor, Tensor] | None, weight: Tensor | None = None) -> Tensor:
        light, count = torch.zeros_like(self.media), self.side.shape[1]
        if seen is None:
            return light
        ray, radiance = seen
        radiance = radiance if weight is None else weight.flatten()[ray, None] * radiance
        return light.index_add_(0, ray // count, radiance) / count

    def noise(self, leaving: Tensor) -> Tensor:
        """(P, 1) half of the difference between the grey light by even rays, as of `radiance` and `skies`, and by odd.
        """
        count = self.side.shape[1]
        sign = 1 - 2 * (torch.arange(count, device=leaving.device) % 2).to(leaving)
        noise = weighted_rows(F.pad(leaving.mean(1, keepdim=True), (0, 0, 0, 1)), self.side, self.share * sign)
        if self.skies is not None:
            ray, radiance = self.skies
            noise[:, 0].index_add_(0, ray // count, radiance.mean(1) * sign[ray % count])
        return noise / count

    def arriving(self, leaving: Tensor, environment: EnvironmentLight | None) -> tuple[Tensor, Tensor]:
        """(P, R) weighted grey radiance along each ray that was not aimed, of surfaces and of the sky.

        leaving: (sides, 3). The sky behind glass is light of surfaces.
        """
        count = self.direction.shape[1]
        bounced = F.pad(leaving.mean(1), (0, 1))[self.side] * self.share
        if self.skies is not None:
            bounced.view(-1).index_add_(0, self.skies[0], self.skies[1].mean(1))
        bounced, direction = bounced[:, :count], self.direction.flatten(0, 1)
        if environment is None:
            return bounced, torch.zeros_like(bounced)
        sky = environment.filtered(direction, torch.full_like(direction[:, 0], BLUR)).view_as(self.direction)
        sky = (self.sky * sky).mean(-1)
        return bounced, sky if self.weight is None else self.weight * sky

    def sky_visibility(self, environment: EnvironmentLight | None, weight: Tensor | None = None) -> Tensor:
        """(P, 3) share of the environment's light that arrives, RGB; weight as above."""
        if environment is None:
            return torch.ones_like(self.media)
        return environment.visible_share(self.direction, self.sky, self.weight if weight is None else weight)


@dataclass
class GatherRays:
    """N = P (R + A) rays of P points on their way to patches."""

    origin: Tensor     # (N, 3)
    direction: Tensor  # (N, 3) unit
    distance: Tensor   # (N,) of what they hit, infinite where that is the sky
    piece: Tensor      # (N,) i64, of the triangles of patches, that which they hit at last
    facing: Tensor     # (N, 3) unit normal of its front
    cosine: Tensor     # (N,) between that and the ray
    side: Tensor       # (N,) as of Gathered
    along: Tensor      # (N, 3) unit, in which they meet that side
    tint: Tensor       # (N, 1) or (N, 3) share of the radiance from there that arrives
    sees_sky: Tensor   # (N,) bool, through no glass, and in no mirror
    mirrored: Mirrored | None  # where they meet polished metal
    skies: tuple[Tensor, Tensor] | None = None  # as of Gathered
    highlights: tuple[Tensor, Tensor] | None = None

    def in_reach(self) -> Tensor:
        """(N, 3) their ends, within the reach of fog."""
        return self.origin + self.distance.clamp(max=FOG_REACH)[:, None] * self.direction

    def pass_polished(self) -> None:
        """Let rays see what is behind polished metal, which mirrors it, with sky and lamps there."""
        row, self.tint = self.mirrored.row, self.tint.repeat(1, 3 // self.tint.shape[1])
        sky = row, self.mirrored.sky * self.tint[row]
        self.skies = sky if self.skies is None else tuple(torch.cat(both) for both in zip(self.skies, sky, strict=True))
        self.highlights = row, self.mirrored.lamps * self.tint[row]
        self.tint[row] *= self.mirrored.color
        self.sees_sky[row] = False


class GatherScene:
    """All patches of a scene, and the surfaces that gather rays hit."""

    def __init__(self, scene: RenderScene, patches: Patches, direct: DirectLight):
        device, rays = direct.device, scene_rays(scene)
        self.count = len(patches.center)
        self._facing = F.pad(F.normalize(patches.facing, dim=-1), (0, 0, 0, 1)).to(device)  # of triangles
        # The row behind all patches stands for "nothing".
        self.patch = F.pad(patches.patch, (0, 1), value=self.count).to(device)
        self._refracts = scene.has_caustics["refractive"]
        seen = patches.patch if self._refracts else patches.patch.where(patches.solid, self.count)
        self._seen = F.pad(seen, (0, 1), value=self.count).to(device)  # the same, nothing for glass that is not seen
        self._bright = self._guide = self.lobes = self._layers = None
        self.corners, self._is_solid = patches.corners.to(device), patches.solid.to(device)
        self._locator = patches.locator.to(device)
        self.fog = direct.fog
        self.environments = {Ray.DIFFUSE: direct.environment, Ray.GLOSSY: direct.sky_seen_by(Ray.GLOSSY)}
        self._media = direct.in_scattering
        self._veils = Veils.of(scene, device)
        self.panes = None
        with part(0.0, 0.5):
            opaque = SOLID | Kind.EMITTER
            stopping = {Ray.DIFFUSE: opaque | STRAIGHT_THROUGH | (Kind(0) if self._refracts else BENDING),
                        Ray.GLOSSY: opaque | STRAIGHT_THROUGH}
            self._opaque = TensorRays(rays.among(opaque, Ray.DIFFUSE))
            self.surfaces = {ray: TensorRays(rays.among(kinds, ray)) for ray, kinds in stopping.items()}
            self._polished = PolishedMetal.of(scene, self.surfaces[Ray.GLOSSY], direct)
        if len(rays.rows(BENDING, Ray.DIFFUSE)):
            with part(0.5, 1.0):
                self.panes = Panes(scene, direct.sky_seen_by(Ray.TRANSMISSION), device)

    def aim(self, importance: Tensor) -> None:
        """Aim rays at patches of such importance (sides,) from now on."""
        self._bright = BrightPatches(self.corners, self._is_solid, self.patch[:-1], importance)

    def guide(self, x: Tensor, n: Tensor, gathered: Gathered, leaving: Tensor) -> None:
        """Guide rays from now on by what these, from points and normals (P, 3), gather of `leaving` (sides, 3)."""
        self._guide = Guide(x, n, gathered.direction, *gathered.arriving(leaving, self.environments[Ray.DIFFUSE]))

    def spread(self, lobes: PatchLobes, layers: PatchLayers) -> None:
        """Compute for all rays from now on how much more than matte sides these lobes, and what is below these layers,
        send along them."""
        self.lobes, self._layers = lobes, layers

    def diffuse(self, position: Tensor, normal: Tensor, start: Tensor, rays: int, aimed: int) -> Gathered:
        """Trace rays from matte points (P, 3) with unit normals (P, 3), and `aimed` more towards bright patches.

        start: (P, 2) in [0, 1), which spreads them.
        """
        matte = MatteRays(position, normal, start, rays, aimed, self._bright, self._guide)
        return self._gather(position, normal, matte.direction, Ray.DIFFUSE, matte=matte)

    def glossy(self, position: Tensor, normal: Tensor, direction: Tensor, roughness: Tensor) -> Gathered:
        """Trace rays from points (P, 3) with unit normals (P, 3) along unit vectors (P, R, 3).

        These are in a lobe of a roughness (P,). Media along the rays dim them, and send no light.
        """
        return self._gather(position, normal, direction, Ray.GLOSSY, roughness=roughness)

    def _gather(self, position: Tensor, normal: Tensor, direction: Tensor, ray: Ray, matte: MatteRays | None = None,
                roughness: Tensor | None = None) -> Gathered:
        """Of matte points or, with their roughness, of glossy ones."""
        position, (count, total) = position + LIFT * normal, direction.shape[:2]
        alpha2 = None if roughness is None else (roughness ** 4 / total).repeat_interleave(total)
        rays = self._cast(position[:, None].expand(-1, total, -1).reshape(-1, 3), direction.reshape(-1, 3), ray, alpha2)
        unaimed, weight, of_unaimed, media, fire = total, None, None, torch.zeros_like(position), None
        if matte is not None:
            self._leave_own_face(rays, normal, total)
            unaimed, (weight, of_unaimed) = matte.unaimed, matte.weights(rays.piece, rays.distance)
            if self.fog is not None:
                media, fire = self._in_scattering(rays, matte, position, normal)
        if self.panes is not None and (self._refracts or ray == Ray.GLOSSY):
            self._pass_glass(rays, ray, weight)
        if rays.mirrored is not None:
            rays.pass_polished()
        share, tint, excess = rays.tint.mean(1), rays.tint, None
        if self.lobes is not None:
            excess = self.lobes.excess(rays.side, rays.along.T).view(count, total)
            share = share * self._layers.factor(rays.side, rays.cosine.abs())
        color = None
        if tint.shape[1] == 3:
            color = (tint / tint.mean(1, keepdim=True).clamp_min(1e-9)).view(count, total, 3)
        share = share.view(count, total) if weight is None else share.view(count, total) * weight
        sky = (rays.sees_sky[:, None] * tint).unflatten(0, (count, total))[:, :unaimed]
        return Gathered(direction[:, :unaimed], rays.side.view(count, total), share, sky, media, of_unaimed, fire,
                        rays.skies, rays.highlights, color, excess)

    def _cast(self, origin: Tensor, direction: Tensor, ray: Ray, alpha2: Tensor | None) -> GatherRays:
        """Rays of a kind from points (N, 3) along unit vectors (N, 3) to what they hit, before any glass.

        alpha2: (N,) of glossy points, squared GGX alpha of a lobe as wide as what each ray stands for.
        """
        with part(0.0, 0.7):
            hits, clear = self.surfaces[ray].nearest(origin, direction), None
            if self._veils is not None:
                hits, clear = self._veils.pass_some(self.surfaces[ray], origin, direction, hits)
        distance, along, mirrored = hits.distance, direction, None
        if alpha2 is not None and self._polished is not None:
            mirrored = self._polished.mirror(origin, direction, hits, alpha2)
            hits, along = mirrored.behind(hits, direction)
        piece = self._locator.find(hits.triangle, hits.weights)
        facing = self._facing.index_select(0, piece)
        cosine = dot(facing, along)
        rays = GatherRays(origin, direction, distance, piece, facing, cosine, self._sides(piece, cosine), along,
                          torch.ones_like(distance)[:, None], distance.isinf(), mirrored)
        if self.fog is not None:
            rays.tint = self.fog.transmittance(origin, rays.in_reach())
        if clear is not None:
            rays.tint = rays.tint * clear
        return rays

    def _leave_own_face(self, rays: GatherRays, normal: Tensor, total: int) -> None:
        """Rays, so many from points with unit normals (P, 3), carry nothing from the face right below, as in Cycles."""
        is_alike = (rays.facing.view(-1, total, 3) @ normal[..., None]).flatten() * -rays.cosine.sign() > ALIKE
        is_below = (rays.distance * rays.cosine).abs() < TOUCHING
        rays.side.masked_fill_(is_alike & is_below, 2 * self.count)

    def _in_scattering(self, rays: GatherRays, matte: MatteRays, position: Tensor,
                       normal: Tensor) -> tuple[Tensor, Tensor | None]:
        """(P, 3) `media` and `fire` of Gathered, at points (P, 3) with unit normals (P, 3)."""
        ends = rays.in_reach().view_as(matte.direction)[:, :matte.plain]
        of_media = position, normal, _some(ends, FOG_RAYS, matte.start[:, 1]), matte.start, self._opaque.is_blocked
        return self._media.to_surfaces.diffuse(*of_media), self._media.fire and self._media.fire.diffuse(*of_media)

    def _pass_glass(self, rays: GatherRays, ray: Ray, weight: Tensor | None) -> None:
        """Let rays see what is behind glass, and those that see the sky there what it mirrors, too."""
        with part(0.7, 1.0):
            glass = self.panes.behind(rays.origin, rays.direction, rays.distance)
        rays.sees_sky[glass.ray] = False
        if self.panes.have_colors and rays.tint.shape[1] == 1:
            rays.tint = rays.tint.repeat(1, 3)
        rays.tint[glass.ray] *= glass.transmittance[:, :rays.tint.shape[1]]
        hits = self.surfaces[ray].nearest(glass.begin, glass.onward)
        piece = self._locator.find(hits.triangle, hits.weights)
        rays.cosine[glass.mirroring] = cosine = dot(self._facing.index_select(0, piece), glass.onward)
        rays.side[glass.mirroring] = self._sides(piece, cosine)
        rays.tint[glass.mirroring] = glass.mirrored.expand(-1, rays.tint.shape[1])
        rays.along = rays.along.index_put((glass.mirroring,), glass.onward)
        row, light = glass.ray, glass.sky
        if self.panes.environment is not None:
            sky = self.panes.environment.filtered(glass.onward, torch.full_like(glass.onward[:, 0], BLUR))
            sky = sky * glass.mirrored * hits.distance.isinf()[:, None]
            row, light = torch.cat([row, glass.mirroring]), torch.cat([light, sky])
        rays.skies = row, light if weight is None else weight.view(-1, 1)[row] * light

    def hit_sides(self, triangle: Tensor, weights: Tensor, direction: Tensor) -> Tensor:
        """(N,) sides, as Gathered has them, of the patches that rays (N, 3) hit.

        At weights (N, 2) of triangles (N,) of the geometry.
        """
        piece = self._locator.find(triangle, weights)
        return self._sides(piece, dot(self._facing.index_select(0, piece), direction))

    def _sides(self, piece: Tensor, cosine: Tensor) -> Tensor:
        """The same for the triangles (N,) of patches, and the cosines (N,) of rays to their fronts' normals."""
        patch, count = self._seen[piece], self.count
        return torch.where(patch < count, patch + count * (cosine > 0), 2 * count)


def _some(rays: Tensor, count: int, start: Tensor) -> Tensor:
    """(P, count, C) of rays (P, R, C) in order, evenly from all of them; start: (P,) in [0, 1)."""
    step = max(rays.shape[1] // count, 1)
    first = (start * step).long().clamp(max=step - 1)
    row = first[:, None] + step * torch.arange(rays.shape[1] // step, device=rays.device)
    return rays.gather(1, row[..., None].expand(-1, -1, rays.shape[2]))
