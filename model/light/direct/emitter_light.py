# SPDX-License-Identifier: GPL-3.0-or-later
"""Light of the emitters: unshadowed in closed form (form_factors.py), visibility by shadow rays.

Shapes: P points, E emitters (polygons first, then spheres); memory grows with P E, so direct_light.py works on chunks
of points. All lengths are in network units, radiance is in the units of the scene. Vectors to emitters are planes
(3, P, E), as in form_factors.py.
"""
from __future__ import annotations

import copy
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from ...fields import COLOR, DIRECTION, Channels
from ...scene import RenderScene
from ...scene_rays import scene_rays
from ...surface_kinds import BENDING, OCCLUDING, SHADING, Kind, Ray
from ..cutouts import Cutouts
from ..fresnel import gain
from ..media.transmittance import Fog
from ..sampling import R2, disk_points, hashed_starts, local_basis, triangle_weights
from ..tensor_rays import TensorRays
from ..vectors import dot, length, unit
from .emitters import DISTANT, ROUND, Limits, gather_emitters
from .environment_light import LIFT
from .footprints import mirrored_turn2, points_within
from .form_factors import (
    MOST_SINE2,
    beam,
    cosines,
    polygon_directions,
    sheen_form_factor,
    sphere_directions,
    sphere_form_factor,
)
from .glossy_lobe import emitter_share, facet_cosines, facet_width2, is_small, small_emitter_share
from .horizon import lambert_vector
from .outlines import CIRCLE, RING, fans, outline_vectors, ring_points, rings
from .picture_maps import PictureMaps
from .terminator import start_heights

FOG_REACH = 3.0  # network units from the centre: fog beyond dims no emitter
END_GAP = 4e-3   # network units before an emitter at which a shadow ray ends
# Squared turn of what a pixel mirrors over that of what facets do, from which on it is sampled finely; and squared size
# of an emitter over the same turn, up to which
FINE, LARGE = 1.0, 100.0
BENEATH = -0.3   # cosine to the middle of a round body, at most, of points on it
PAIRS = 1 << 14  # of points and emitters, whose outlines are integrated over at a time
STRONGEST = 3    # emitters that `strongest` finds
LONG = 5.0         # times that a side of an emitter is longer than another, from which on it is as it is seen
IN_PLANE = 1e-3    # network units above the plane of a point up to which a polygon lies in it
LARGE_SINE2 = 3e-3  # of a polygon, from which on what the horizon leaves of it is exact
DIM = 0.02       # of the brightest highlight at a point, below which others are left out
# Fields of EmitterLight that have a row for each emitter.
OF_POLYGONS, OF_SPHERES = ("corners", "rings", "_points", "_is_long", "_fan"), ("centers", "radii")
OF_ALL = ("origins", "reach", "is_distant", "radiance", "beam_axis", "beam_cosine", "_outward", "_is_seen", "_before",
          "_occluder", "_casts_shadows")
EMITTER = Channels(  # what it finds of an emitter at a point
    1,
    toward=(3, DIRECTION),  # unit direction to it
    nearness=1,             # 1 / (1 + distance), 0 for a sun
    sine=1,                 # of half the angle that it fills
    share=(3, COLOR),       # of all unshadowed light that a diffuse surface sends on
)


class NearEmitters(NamedTuple):
    """E emitters within the scene."""

    position: np.ndarray     # (E, 3) f32
    power_share: np.ndarray  # (E,) f32, sum 1


class EmitterLight:
    """The emitters of a normalised scene, and what stands between them and surfaces."""

    def __init__(self, scene: RenderScene, fog: Fog | None, device: torch.device | str,
                 cutouts: Cutouts | None = None):
        emitters = gather_emitters(scene)
        to_tensor = lambda x: torch.as_tensor(x, dtype=torch.float32, device=device)  # noqa: E731
        self.corners, self.centers, self.radii = map(to_tensor, (emitters.corners, emitters.centers, emitters.radii))
        self.rings = to_tensor(rings(emitters.corners))
        points = self._points = ring_points(self.rings)
        edges = self.rings[..., 3:6].norm(dim=-1)
        self._is_long = edges.amax(1) > LONG * edges.amin(1)
        self.origins = torch.cat([points.mean(1), self.centers])
        self.reach = torch.cat([(points - points.mean(1, keepdim=True)).norm(dim=-1).amax(1), self.radii])
        self.is_distant = self.origins.norm(dim=-1) > DISTANT
        self.radiance, self.beam_axis, self.beam_cosine = map(
            to_tensor, (emitters.radiance, emitters.beam_axis, emitters.beam_cosine))
        self.fog, self._cutouts = fog, cutouts
        self._fan = to_tensor(fans(emitters.corners))
        self._outward = F.pad(to_tensor(emitters.outward), (0, 0, 0, len(emitters.radii)))
        self._maps = PictureMaps(emitters.pictures, emitters.cells, device) if emitters.pictures else None
        self._limits = Limits(*(values[emitters.kind] for values in Limits.of(scene)[0]))
        is_seen = self._limits.is_lamp == 0
        self._is_seen, self._shining = torch.as_tensor(is_seen, device=device), None
        self._casts_shadows = torch.as_tensor(self._limits.blockers > 0, device=device)
        self._has_bodies = bool(is_seen[len(emitters.corners):].any())
        # What shines to one side is at the place of its surface, lumps and spheres stand for one around them.
        self._before = torch.where(self.beam_axis.any(1), END_GAP, ROUND * self.reach)
        if is_seen.sum() > 1:
            self._shining = TensorRays(scene_rays(scene).among(Kind.EMITTER, Ray.SHADOW))
        self._occluders, self._occluder = _occluders(scene, self._limits, device)
        self._divide()

    def past_glass(self, scene: RenderScene, cutouts: Cutouts | None) -> EmitterLight:
        """The light that glass does not stop, but dims as all `cutouts` do."""
        light = copy.copy(self)
        light._cutouts = cutouts
        light._occluders, light._occluder = _occluders(scene, self._limits, self.radiance.device, BENDING)
        return light

    def _divide(self) -> None:
        """The radiance (E, 3) that goes to lobes, into the air, and through glass."""
        def seen_by(ray: Ray) -> Tensor:
            is_seen = (self._limits.hidden & np.uint64(ray)) == 0
            return self._only(is_seen)

        self._to_diffuse, self._to_glossy, self._to_air, self._through_glass = map(
            seen_by, (Ray.DIFFUSE, Ray.GLOSSY, Ray.SCATTER, Ray.TRANSMISSION))

    def _only(self, chosen: np.ndarray) -> Tensor:
        """(E, 3) radiance, of the emitters that are not chosen (E,) none."""
        if chosen.all():
            return self.radiance
        return self.radiance * torch.as_tensor(chosen).to(self.radiance)[:, None]

    @property
    def bounces(self) -> set[int]:
        """Most bounces that the light of some emitter has."""
        return set(self._limits.bounces.tolist())

    def reaching(self, group: int | None = None,
                 bounces: Callable[[np.ndarray], np.ndarray] | None = None) -> EmitterLight:
        """The same places, and the light alone that falls on a group of surfaces, and whose most bounces are chosen."""
        reaches = np.ones(len(self), bool)
        if group is not None:
            reaches &= (self._limits.groups >> np.uint64(group)) & np.uint64(1) > 0
        if bounces is not None:
            reaches &= bounces(self._limits.bounces)
        return self if reaches.all() else self._reaching(reaches)

    def _reaching(self, chosen: np.ndarray) -> EmitterLight:
        """The same places, and the light alone of those that are chosen (E,)."""
        some = copy.copy(self)
        some.radiance = self._only(chosen)
        some._divide()
        return some

    def __len__(self) -> int:
        return len(self.radiance)

    def near(self) -> NearEmitters:
        """The emitters that are no suns."""
        corners, radii, radiance, position, is_near = (x.cpu().numpy() for x in (
            self.corners, self.radii, self.radiance, self.origins, ~self.is_distant))
        silhouette = np.concatenate([np.linalg.norm(outline_vectors(corners), axis=1), 2 * np.pi * radii**2])
        power = (silhouette * radiance.mean(axis=1))[is_near]
        return NearEmitters(position[is_near], power / max(power.sum(), 1e-20))

    def strongest_lamps(self, most: int) -> tuple[list[EmitterLight], EmitterLight]:
        """Each of the strongest emitters that are no suns by itself, and all others, in whose places those are dark."""
        near = torch.nonzero(~self.is_distant)[:, 0].cpu().numpy()
        chosen = near[np.argsort(-self.near().power_share, kind="stable")[:most]]
        return [self._alone(row) for row in chosen], self._reaching(~np.isin(np.arange(len(self)), chosen))

    def _alone(self, row: int) -> EmitterLight:
        """One emitter."""
        one, polygons = copy.copy(self), len(self.corners)
        own, of_spheres = slice(row, row + 1), slice(max(row - polygons, 0), max(row - polygons + 1, 0))
        for names, rows in ((OF_POLYGONS, own), (OF_SPHERES, of_spheres), (OF_ALL, own)):
            for name in names:
                setattr(one, name, getattr(self, name)[rows])
        one._maps = None
        one._limits = Limits(*(values[own] for values in self._limits))
        one._divide()
        return one

    def visibility(self, x: Tensor, n: Tensor, origin: Tensor, start: Tensor, *gloss: Tensor) -> tuple[Tensor, ...]:
        """Share of the emitters' light at points x (P, 3) with unit normals n (P, 3) that is not blocked, (P, 3) each.

        Of the light that a diffuse lobe sends on, and with `gloss` (outgoing (P, 3), roughness and f0 (P,)) that of a
        glossy lobe too. By K shadow rays to each emitter, from `origin` (P, K, 3) on the same surface, spread over it
        by `start` (P, K, 2) in [0, 1). origin may have the unit normal of its face too, and the way up to the curved
        surface there (terminator.py), (P, K, 9). The last (P, 1) is how far rays to one emitter disagree: 0 where all
        or none arrive, 1 where half do.
        """
        direction, sine2, in_beam = self._directions(x, n)
        cosine = cosines(direction, n)
        lobes = [self._form_factor(x, n, cosine, sine2) * in_beam]
        if gloss:
            lobes.append(self._glossy(x, n, direction, sine2, *gloss) * in_beam)
        visible = self._visible(origin, n, start, lobes[0] > 0, direction)
        share, power = visible.mean(-1), lobes[0] * self._to_diffuse.mean(1)
        spread2 = (power.square() * share * (1 - share)).sum(1, keepdim=True).clamp_min(0)
        disagreement = 2 * spread2.sqrt() / power.sum(1, keepdim=True).clamp_min(1e-12)
        return *(_arriving(lobe, visible, radiance) / (lobe @ radiance).clamp_min(1e-12)
                 for lobe, radiance in zip(lobes, (self._to_diffuse, self._to_glossy))), disagreement

    def highlights(self, x: Tensor, n: Tensor, start: Tensor, *gloss: Tensor) -> Tensor:
        """(P, 3) radiance of the emitters that white glossy lobes send on, past what is in the way.

        Arguments as of `visibility`; shadow rays go to the emitters alone that the lobe of a point shows.
        """
        direction, sine2, in_beam = self._directions(x, n)
        lobe = self._glossy(x, n, direction, sine2, *gloss) * in_beam
        power = lobe * self._to_glossy.mean(1)
        is_shown = power > DIM * power.amax(1, keepdim=True)
        return _arriving(lobe * is_shown, self._visible(x[:, None], n, start, is_shown, direction), self._to_glossy)

    def _visible(self, origin: Tensor, n: Tensor, start: Tensor, is_lit: Tensor, direction: Tensor) -> Tensor:
        """As `_trace_shadows`, by K rays of points with unit normals (P, 3); origin as of `visibility`, or (P, 1, ...),
        start: (P, K, 2)."""
        origin, *curved = origin.split(3, 2)
        raised = None
        if curved:  # of a point all rays have the same
            face, up = (x[:, 0] for x in curved)
            raised = start_heights(direction, face, n), up
        rays = zip(origin.expand(-1, start.shape[1], -1).unbind(1), start.unbind(1), strict=True)
        return sum(self._trace_shadows(x + LIFT * n, is_lit, direction, on_emitter, n, raised)
                   for x, on_emitter in rays) / start.shape[1]

    def _trace_shadows(self, x: Tensor, is_lit: Tensor, direction: Tensor, start: Tensor, n: Tensor | None = None,
                       raised: tuple[Tensor, Tensor] | None = None) -> Tensor:
        """(P, E, 1) or (P, E, 3) share of each emitter's light that arrives at points (P, 3) by one ray.

        Where `is_lit` (P, E). direction: (3, P, E), to the emitters; start: (P, 2), where on them the rays end.
        n: (P, 3) unit normals, below whose horizon no ray goes; raised: a share (P, E) of a way (P, 3) from the points,
        at which rays start.
        """
        point, emitter = (is_lit & self._casts_shadows).nonzero().unbind(1)
        origin, is_near = x[point], ~self.is_distant[emitter, None]
        if raised is not None:
            origin = origin + raised[0][point, emitter, None] * raised[1][point]
        ray = self._points_on(emitter, direction[:, point, emitter].T, start[point]) - origin * is_near
        if n is not None:
            ray = _above_horizon(ray, self.origins[emitter] - origin * is_near, n[point])
        distance = length(ray)
        ray, end = ray / distance.clamp_min(1e-9)[:, None], distance - END_GAP
        is_blocked = self._is_blocked(emitter, origin, ray, end)
        if self._shining is not None:
            # Shells that are seen from outside would hide themselves: lumps that stand for them lie below.
            faces = self._is_seen[emitter] & (dot(self._outward[emitter], ray) >= 0)
            others = (~is_blocked & faces).nonzero()[:, 0]
            is_blocked[others] = self._shining.is_blocked(
                *(rays[others] for rays in (origin, ray, distance - self._before[emitter])))
        arrives = 1.0 * ~is_blocked[:, None]
        if self._cutouts is not None:
            arrives = arrives * self._cutouts.transmittance(origin, ray, end * arrives[:, 0])
        visible = arrives.new_zeros(*is_lit.shape, arrives.shape[1]).index_put((point, emitter), arrives)
        if self.fog is not None:
            visible = visible * self.fog.transmittance(x[:, None], self.origins.renorm(2, 0, FOG_REACH))
        return torch.where(self._casts_shadows[:, None], visible, is_lit[..., None])

    def _is_blocked(self, emitter: Tensor, *rays: Tensor) -> Tensor:
        """(R,) bool of rays to emitters (R,), as TensorRays.is_blocked has them."""
        if len(self._occluders) == 1:
            return self._occluders[0].is_blocked(*rays)
        is_blocked, occluder = torch.zeros_like(emitter, dtype=torch.bool), self._occluder[emitter]
        for i, occluders in enumerate(self._occluders):
            rows = (occluder == i).nonzero()[:, 0]
            is_blocked[rows] = occluders.is_blocked(*(x[rows] for x in rays))
        return is_blocked

    def _points_on(self, emitter: Tensor, direction: Tensor, start: Tensor) -> Tensor:
        """(R, 3) points on emitters (R,); on spheres those of the disk that faces unit vectors (R, 3).

        start: (R, 2) in [0, 1).
        """
        u, v = ((start[:, i] + emitter * step) % 1 for i, step in enumerate(R2))
        polygons = len(self.corners)
        on_disk = disk_points(direction, u, v) * F.pad(self.radii, (polygons, 0))[emitter, None]
        if not polygons:
            return self.origins[emitter] + on_disk
        on_polygon = self._points_on_polygons(emitter.clamp(max=polygons - 1), u, v)
        return torch.where((emitter < polygons)[:, None], on_polygon, self.origins[emitter] + on_disk)

    def _points_on_polygons(self, polygon: Tensor, u: Tensor, v: Tensor) -> Tensor:
        """(R, 3) points that cover polygons (R,) evenly for u, v (R,) in [0, 1): triangles around corner 0 by area."""
        fan = self._fan[polygon]
        triangle = (fan[:, 1:-1] <= u[:, None]).sum(1, keepdim=True)
        first, last = (fan.gather(1, triangle + i)[:, 0] for i in (0, 1))
        corners = self.corners[polygon[:, None], F.pad(triangle + torch.tensor([1, 2], device=u.device), (1, 0))]
        share = ((u - first) / (last - first).clamp_min(1e-12)).clamp(0, 1)
        return (corners * triangle_weights(share, v)[..., None]).sum(1)

    def radiance_in_air(self, x: Tensor) -> Tensor:
        """(P, 3) radiance that arrives in the air at points x (P, 3), the mean over all directions."""
        direction, sine2, in_beam = self._directions(x)
        is_lit = (in_beam > 0) & self._to_air.any(1)
        return _arriving(sine2 / 4 * in_beam, self._trace_shadows(x, is_lit, direction, hashed_starts(x, 2)),
                         self._to_air)

    def unshadowed_in_air(self, x: Tensor) -> Tensor:
        """The same without what is in the way."""
        _, sine2, in_beam = self._directions(x)
        return (sine2 / 4 * in_beam) @ self._to_air

    def diffuse(self, x: Tensor, n: Tensor, *layer: Tensor) -> tuple[Tensor, ...]:
        """Unshadowed radiance (P, 3) leaving a white diffuse surface at points x (P, 3) with unit normals n (P, 3).

        With f0 and roughness (P,) of a dielectric `layer` also the same light as the layer weighs it, relative to what
        it would reflect of light from everywhere, so that its mean albedo can be multiplied with it; and the unit
        vectors to emitters (P, 3), times the mean of its channels.
        """
        direction, form_factor = self._form_factors(x, n)
        radiance = [form_factor @ self._to_diffuse]
        if layer:
            f0, roughness = layer
            weight = form_factor * gain(f0, cosines(direction, n), roughness)
            toward = [(weight * axis) @ self._to_glossy.mean(1) for axis in direction]
            radiance += [weight @ self._to_glossy, torch.stack(toward, -1)]
        return tuple(radiance)

    def strongest(self, x: Tensor, n: Tensor, other: Tensor) -> Tensor:
        """(P, STRONGEST, len(EMITTER)): the emitters that unshadowed light a white diffuse surface most, the strongest
        first; zeros where there are fewer. `other` (P, 3) is the radiance of that surface by all other light.
        """
        result = x.new_zeros(len(x), STRONGEST, len(EMITTER))
        if not len(self):
            return result
        direction, sine2, in_beam = self._directions(x, n)
        form_factor = self._form_factor(x, n, cosines(direction, n), sine2) * in_beam
        power, emitter = (form_factor * self._to_diffuse.mean(1)).topk(min(STRONGEST, len(self)), dim=1)
        point = torch.arange(len(x), device=x.device)[:, None]
        complete = (form_factor @ self._to_diffuse + other).clamp_min(1e-12)
        distance = length(self.origins[emitter] - x[:, None])
        nearness = ~self.is_distant[emitter] / (1 + distance)
        share = form_factor[point, emitter][..., None] * self._to_diffuse[emitter] / complete[:, None]
        parts = {"toward": direction[:, point, emitter].movedim(0, -1), "nearness": nearness[..., None],
                 "sine": sine2[point, emitter].sqrt()[..., None], "share": share}
        found = torch.cat([parts[name] for name in EMITTER.parts], -1) * (power > 0)[..., None]
        result[:, :found.shape[1]] = found
        return result

    def sheen(self, x: Tensor, n: Tensor, stretch: Tensor) -> tuple[Tensor, Tensor]:
        """Unshadowed radiance (P, 3) leaving a white diffuse surface and a white sheen of such a stretch (P,)."""
        direction, sine2, in_beam = self._directions(x, n)
        cosine = cosines(direction, n)
        of_diffuse = self._form_factor(x, n, cosine, sine2)
        of_sheen = sheen_form_factor(cosine, sine2, stretch[:, None])
        return (of_diffuse * in_beam) @ self._to_diffuse, (of_sheen * in_beam) @ self._to_diffuse

    def lobes(self, x: Tensor, n: Tensor, *gloss: Tensor) -> tuple[Tensor, Tensor]:
        """Unshadowed radiance (P, 3) leaving a white diffuse and a white glossy lobe; arguments as of `visibility`.

        A footprint (P, 2, 9) may follow (footprints.py).
        """
        if not len(self):
            return torch.zeros_like(x), torch.zeros_like(x)
        direction, sine2, in_beam = self._directions(x, n)
        cosine = cosines(direction, n)
        diffuse = self._form_factor(x, n, cosine, sine2) * in_beam
        glossy = self._glossy(x, n, direction, sine2, *gloss) * in_beam
        return diffuse @ self._to_diffuse, glossy @ self._to_glossy + self._detail(glossy, x, n, *gloss)

    def _detail(self, share: Tensor, x: Tensor, n: Tensor, v: Tensor, roughness: Tensor, f0: Tensor,
                footprint: Tensor | None = None) -> Tensor | float:
        """(P, 3) what pictures show beyond the means of their cells in lobes that have shares (P, E) of emitters."""
        if self._maps is None:
            return 0.0
        turn2 = torch.zeros_like(roughness) if footprint is None else mirrored_turn2(footprint)
        shown, by_maps = self._maps.shown(x, n, v, roughness, turn2)
        last = slice(len(self.corners) - by_maps.shape[1] * self._maps.cells, len(self.corners))
        cells = share[:, last].unflatten(1, (-1, self._maps.cells))
        means = self._to_glossy[last].unflatten(0, cells.shape[1:])
        shines = means.flatten(1).any(1)
        difference = cells.sum(2)[..., None] * shown - torch.einsum("pkc,kcj->pkj", cells, means)
        return (difference * (by_maps * shines)[..., None]).sum(1)

    def _glossy(self, x: Tensor, n: Tensor, direction: Tensor, sine2: Tensor, v: Tensor, roughness: Tensor,
                f0: Tensor, footprint: Tensor | None = None) -> Tensor:
        """(P, E) share of the emitters' radiance that a white glossy lobe sends on; directions as of `_directions`."""
        facets = facet_cosines(direction, n, v)
        share = small_emitter_share(facets, sine2, roughness, f0)
        to_emitter = self.origins.T[:, None] - x.T[..., None] * ~self.is_distant
        distance2 = dot(to_emitter, to_emitter, 0)
        size2 = self.reach.square() / distance2.clamp_min(1e-20)
        if footprint is None:
            is_exact = ~is_small(facets, size2, roughness)
            return self._with_exact(share, is_exact & (sine2 > 0), x, n, v, roughness, f0)
        turn2 = mirrored_turn2(footprint)[:, None]
        is_exact = ~is_small(facets, size2 + turn2, roughness) & (sine2 > 0)
        is_finer = (turn2 > FINE * facet_width2(roughness)[:, None]) & (size2 < LARGE * turn2)
        share = self._with_exact(share, is_exact & ~is_finer, x, n, v, roughness, f0)
        return self._with_exact(share, is_exact & is_finer, x, n, v, roughness, f0, footprint)

    def _with_exact(self, share: Tensor, where: Tensor, *points: Tensor) -> Tensor:
        """`share` (P, E) with that of whole outlines `where` (P, E); points: x, n, v, roughness, f0, or footprints too,
        in which the mean is taken."""
        pairs = where.nonzero()
        if not len(pairs):
            return share
        exact = [self._mean_share(emitter, *(values[point] for values in points))
                 for point, emitter in (some.unbind(1) for some in pairs.split(PAIRS))]
        return share.index_put(pairs.unbind(1), torch.cat(exact))

    def _mean_share(self, emitter: Tensor, x: Tensor, n: Tensor, v: Tensor, roughness: Tensor, f0: Tensor,
                    footprint: Tensor | None = None) -> Tensor:
        """(R,) of pairs."""
        def share(x: Tensor, n: Tensor, v: Tensor) -> Tensor:
            return emitter_share(self._outlines(x, emitter), n.T, v.T, roughness, f0)

        if footprint is None:
            return share(x, n, v)
        surface = torch.cat([x, n, v], 1)
        shares = []
        for change in points_within(footprint):
            x, n, v = (surface + change).split(3, 1)
            shares.append(share(x, unit(n), unit(v)))
        return sum(shares) / len(shares)

    def _outlines(self, x: Tensor, emitter: Tensor) -> Tensor:
        """(RING, 3, R) vectors from points (R, 3) to the outlines of emitters (R,)."""
        origin = x * ~self.is_distant[emitter, None]
        polygons = len(self.corners)
        vectors = torch.zeros(len(x), RING, 3, device=x.device)
        if polygons:
            polygon = emitter.clamp(max=polygons - 1)
            vectors = self._points[polygon] - origin[:, None]
            long = self._is_long[polygon].nonzero()[:, 0]
            vectors[long] = _as_seen(self.rings[polygon[long]], origin[long, None])
        radius = F.pad(self.radii, (polygons, 0))[emitter]
        sphere = self.origins[emitter] - origin
        across = radius / (dot(sphere, sphere) - radius.square()).clamp_min(1e-12).sqrt()
        towards = unit(sphere)
        around = torch.from_numpy(CIRCLE).to(x.device) @ local_basis(towards)[:, :2]
        of_sphere = towards[:, None] + across[:, None, None] * around
        return torch.where((emitter < polygons)[:, None, None], vectors, of_sphere).permute(1, 2, 0).contiguous()

    def sample(self, x: Tensor, n: Tensor, start: Tensor) -> tuple[Tensor, Tensor]:
        """One emitter for each point x (P, 3), chosen in proportion to its unshadowed light there.

        Returns the vector to it (P, 3), a direction for suns, and the radiance (P, 3) that a white diffuse surface with
        the unit normal n (P, 3) would send on if all light came from there, on whichever side is lit. start: (P, 2) in
        [0, 1).
        """
        direction, form_factor = self._form_factors(x, n)
        form_factor = form_factor + self._form_factors(x, -n)[1]
        radiance = self._through_glass
        power = (form_factor * radiance.mean(1)).cumsum(1)
        threshold = power[:, -1:] * start.sum(1, keepdim=True).frac()
        emitter = torch.searchsorted(power, threshold, right=True)[:, 0].clamp(max=form_factor.shape[1] - 1)
        point = torch.arange(len(x), device=x.device)
        on_emitter = self._points_on(emitter, direction[:, point, emitter].T, start)
        color = radiance[emitter] / radiance[emitter].mean(1, keepdim=True).clamp_min(1e-20)
        return on_emitter - x * ~self.is_distant[emitter, None], color * power[:, -1:]

    def _form_factors(self, x: Tensor, n: Tensor) -> tuple[Tensor, Tensor]:
        """Unit direction (3, P, E) to every emitter, and the share of its radiance that a diffuse surface sends on."""
        direction, sine2, in_beam = self._directions(x, n)
        return direction, self._form_factor(x, n, cosines(direction, n), sine2) * in_beam

    def _form_factor(self, x: Tensor, n: Tensor, cosine: Tensor, sine2: Tensor) -> Tensor:
        """(P, E) share of the emitters' light that a diffuse surface sends on, by cosines to and squared sines of them.

        Polygons that the horizon cuts count as spheres of their solid angle where they are small.
        """
        polygons = len(self.corners)
        lowest, highest = self._heights(x, n)
        form_factor = sphere_form_factor(cosine, sine2)
        whole = cosine[:, :polygons].clamp_min(0) * sine2[:, :polygons]
        of_polygons = torch.where(lowest >= 0, whole, form_factor[:, :polygons])
        cut = (lowest < 0) & (highest > 0) & (sine2[:, :polygons] > LARGE_SINE2)
        point, emitter = cut.nonzero().unbind(1)
        for some, of_some in zip(point.split(PAIRS), emitter.split(PAIRS), strict=True):
            basis = local_basis(n[some])
            ring = unit(torch.einsum("rij,kjr->kir", basis, self._outlines(x[some], of_some)), 1)
            of_polygons[some, of_some] = lambert_vector(ring)[2].abs() / (2 * math.pi)
        return torch.cat([of_polygons, form_factor[:, polygons:]], 1)

    def _heights(self, x: Tensor, n: Tensor) -> tuple[Tensor, Tensor]:
        """(P, E) of the lowest and the highest corner of polygons, above the planes of points with unit normals."""
        height = (n @ self.corners.flatten(0, 1).T).unflatten(1, self.corners.shape[:2])
        ground = dot(x, n)[:, None] * ~self.is_distant[:len(self.corners)]
        return height.amin(2) - ground, height.amax(2) - ground

    def _directions(self, x: Tensor, n: Tensor | None = None) -> tuple[Tensor, Tensor, Tensor]:
        """Unit direction (3, P, E) to every emitter, its squared angular sine and its beam's share of radiance.

        With unit normals n (P, 3) none of a polygon in whose plane a point lies, and of a round body on which it lies:
        the sphere that stands for that is above some of its faces.
        """
        points, polygons = x, len(self.corners)
        x = x.T[..., None] * ~self.is_distant  # light of suns is parallel
        of_polygons = polygon_directions(self.corners, x[..., :polygons])
        of_spheres = sphere_directions(self.centers, self.radii, x[..., polygons:])
        direction, sine2 = (torch.cat(both, -1) for both in zip(of_polygons, of_spheres, strict=True))
        in_beam = beam(direction, sine2, self.beam_axis, self.beam_cosine)
        if n is not None and polygons:
            in_beam[:, :polygons] *= self._heights(points, n)[1] > IN_PLANE
        if n is not None and self._has_bodies:
            is_near = self._is_seen[polygons:] & (sine2[:, polygons:] > ROUND ** -2)
            in_beam[:, polygons:] *= ~(is_near & (cosines(direction[..., polygons:], n) < BENEATH))
        return direction, sine2.clamp(0, MOST_SINE2), in_beam


def _occluders(scene: RenderScene, limits: Limits, device: torch.device | str,
               passed: int = 0) -> tuple[list[TensorRays], Tensor]:
    """What stops the light of emitters (E,) of some limits, and which of it is that of each, (E,) i64.

    Surfaces that shine stop that of lamps alone: no emitter shades itself. passed: what stops none.
    """
    kinds, occluder = np.unique(np.stack([limits.blockers, limits.is_lamp], 1), axis=0, return_inverse=True)
    rays = scene_rays(scene)
    return [TensorRays(rays.among((SHADING if is_lamp else OCCLUDING) & ~passed, Ray.SHADOW, int(groups)))
            for groups, is_lamp in kinds], torch.as_tensor(occluder.reshape(-1), device=device)


def _arriving(weight: Tensor, visible: Tensor, radiance: Tensor) -> Tensor:
    """(P, 3) sum of radiance (E, 3) by weights (P, E), of which a share (P, E, 1) or (P, E, 3) arrives."""
    if visible.shape[2] == 1:
        return (weight * visible[..., 0]) @ radiance
    return torch.einsum("pe,pec,ec->pc", weight, visible, radiance)


def _as_seen(ring: Tensor, x: Tensor) -> Tensor:
    """(R, K, 3) vectors from points x (R, 1, 3) to those of rings (R, K, 7), spread by angle over each edge.

    Spread by length, those of a long lamp would be far apart where it is close.
    """
    start, edge, before = ring.split([3, 3, 1], -1)
    start = start - x
    length2 = dot(edge, edge)[..., None].clamp_min(1e-12)
    closest = -dot(start, edge)[..., None] / length2
    beside = (dot(start, start)[..., None] / length2 - closest.square()).clamp_min(1e-6).sqrt()
    first, last = (torch.atan((end - closest) / beside) for end in (0, 1))
    return start + edge * (closest + beside * torch.lerp(first, last, before).tan()).clamp(0, 1)


def _above_horizon(ray: Tensor, middle: Tensor, n: Tensor) -> Tensor:
    """Vectors (R, 3) to emitters, those below the horizon of unit normals (R, 3) mirrored at their middle (R, 3).

    Form factors are of what is above it alone, and so is what is visible of that.
    """
    ray = torch.where(dot(ray, n)[:, None] < 0, 2 * middle - ray, ray)
    return ray - dot(ray, n).clamp(max=0)[:, None] * n
