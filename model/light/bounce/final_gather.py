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
from .panes import BehindGlass, Panes
from .patch_lobes import PatchLobes
from .patches import Patches
from .polished import PolishedMetal

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
        self._bright = self._guide = self.lobes = None
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

    def spread(self, lobes: PatchLobes) -> None:
        """Compute for all rays from now on how much more than matte sides these lobes send along them."""
        self.lobes = lobes

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
        position, rays = position + LIFT * normal, direction.shape[1] if matte is None else matte.unaimed
        total, direction = direction.shape[1], direction.reshape(-1, 3)
        origin = position[:, None].expand(-1, total, -1).reshape(-1, 3)
        with part(0.0, 0.7):
            hits, straight = self.surfaces[ray].nearest(origin, direction), None
            if self._veils is not None:
                hits, straight = self._veils.pass_some(self.surfaces[ray], origin, direction, hits)
        distance, along, mirrored = hits.distance, direction, None
        if roughness is not None and self._polished is not None:
            mirrored = self._polished.mirror(origin, direction, hits, (roughness ** 4 / total).repeat_interleave(total))
            hits, along = mirrored.behind(hits, direction)
        piece = self._locator.find(hits.triangle, hits.weights)
        facing = self._facing.index_select(0, piece)
        cosine = dot(facing, along)
        side = self._sides(piece, cosine)
        if matte is not None:  # rays into the face that they start from, right below them, carry nothing in Cycles
            is_alike = (facing.view(-1, total, 3) @ normal[..., None]).flatten() * -cosine.sign() > ALIKE
            side.masked_fill_(is_alike & ((distance * cosine).abs() < TOUCHING), 2 * self.count)
        tint, sky, fire, skies, highlights = torch.ones_like(distance)[:, None], distance.isinf(), None, None, None
        media = torch.zeros_like(position)
        weight, of_unaimed = (None, None) if matte is None else matte.weights(piece, distance)
        if self.fog is not None:
            end = origin + distance.clamp(max=FOG_REACH)[:, None] * direction
            tint = self.fog.transmittance(origin, end)
            if matte is not None:
                some = _some(end.view(-1, total, 3)[:, :matte.plain], FOG_RAYS, matte.start[:, 1])
                of_media = position, normal, some, matte.start, self._opaque.is_blocked
                media += self._media.to_surfaces.diffuse(*of_media)
                fire = self._media.fire and self._media.fire.diffuse(*of_media)
        if straight is not None:
            tint = tint * straight
        if self.panes is not None and (self._refracts or ray == Ray.GLOSSY):
            with part(0.7, 1.0):
                glass = self.panes.behind(origin, direction, distance)
            row, light, transmittance = glass.ray, glass.sky, glass.transmittance
            sky[row] = False
            if self.panes.have_colors and tint.shape[1] == 1:
                tint = tint.repeat(1, 3)
            tint[row] *= transmittance if tint.shape[1] == 3 else transmittance[:, :1]
            row, light = self._mirrored_by(glass, ray, side, tint, row, light)
            along = along.index_put((glass.mirroring,), glass.onward)
            skies = row, light if weight is None else weight.view(-1, 1)[row] * light
        if mirrored is not None:
            row, tint = mirrored.row, tint.repeat(1, 3 // tint.shape[1])
            skies = _joined(skies, (row, mirrored.sky * tint[row]))
            highlights = row, mirrored.lamps * tint[row]
            tint[row] *= mirrored.color
            sky[row] = False
        share = tint.mean(1)
        color = (tint / share[:, None].clamp_min(1e-9)).view(-1, total, 3) if tint.shape[1] == 3 else None
        sky = (sky[:, None] * tint).unflatten(0, (-1, total))[:, :rays]
        excess = None if self.lobes is None else self.lobes.excess(side, along.T).view(-1, total)
        side, share, direction = side.view(-1, total), share.view(-1, total), direction.view(-1, total, 3)[:, :rays]
        share = share if weight is None else share * weight
        return Gathered(direction, side, share, sky, media, of_unaimed, fire, skies, highlights, color, excess)

    def _mirrored_by(self, glass: BehindGlass, ray: Ray, side: Tensor, tint: Tensor, row: Tensor,
                     light: Tensor) -> tuple[Tensor, Tensor]:
        """Let rays that see the sky through glass meet the patches that it mirrors, too: in place.

        Returns their numbers and the radiance of the sky, `row` (M,) and `light` (M, 3), with that of mirrored sky.
        """
        hits = self.surfaces[ray].nearest(glass.begin, glass.onward)
        side[glass.mirroring] = self.hit_sides(hits.triangle, hits.weights, glass.onward)
        tint[glass.mirroring] = glass.mirrored.expand(-1, tint.shape[1])
        if self.panes.environment is None:
            return row, light
        sky = self.panes.environment.filtered(glass.onward, torch.full_like(glass.onward[:, 0], BLUR))
        sky = sky * glass.mirrored * hits.distance.isinf()[:, None]
        return torch.cat([row, glass.mirroring]), torch.cat([light, sky])

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


def _joined(seen: tuple[Tensor, Tensor] | None, more: tuple[Tensor, Tensor]) -> tuple[Tensor, Tensor]:
    return more if seen is None else tuple(torch.cat(both) for both in zip(seen, more, strict=True))


def _some(rays: Tensor, count: int, start: Tensor) -> Tensor:
    """(P, count, C) of rays (P, R, C) in order, evenly from all of them; start: (P,) in [0, 1)."""
    step = max(rays.shape[1] // count, 1)
    first = (start * step).long().clamp(max=step - 1)
    row = first[:, None] + step * torch.arange(rays.shape[1] // step, device=rays.device)
    return rays.gather(1, row[..., None].expand(-1, -1, rays.shape[2]))
