# SPDX-License-Identifier: GPL-3.0-or-later
"""Light of the emitters: unshadowed in closed form (emitter_shapes.py), visibility by shadow rays (emitter_shadows.py).

Shapes: P points, E emitters (polygons first, then spheres); memory grows with P E, so direct_light.py works on chunks
of points. All lengths are in network units, radiance is in the units of the scene. Vectors to emitters are planes
(3, P, E), as in form_factors.py.
"""
from __future__ import annotations

import copy
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ...fields import COLOR, DIRECTION, Channels
from ...material.reflectance import widened
from ...scene import RenderScene
from ...surface_kinds import Ray
from ..cutouts import Cutouts
from ..fresnel import gain
from ..media.transmittance import Fog
from ..sampling import ggx_directions, hashed_starts
from ..vectors import dot, length
from .emitter_shadows import EmitterShadows
from .emitter_shapes import EmitterShapes
from .emitters import Limits, gather_emitters
from .environment_light import LIFT
from .footprints import mirrored_turn2
from .form_factors import cosines, sheen_form_factor
from .outlines import outline_vectors
from .picture_maps import PictureMaps

POLISHED, DULL = 0.1, 0.3  # roughness up to which rays along lobes say what is before emitters, and from which none do
LOBE_RAYS = 8    # of a pixel, along its lobe
STRONGEST = 3    # emitters that `strongest` finds
DIM = 0.02       # of the brightest highlight at a point, below which others are left out
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
        self.radiance = torch.as_tensor(emitters.radiance, dtype=torch.float32, device=device)
        self._limits = Limits(*(values[emitters.kind] for values in Limits.of(scene)[0]))
        self.shapes = EmitterShapes(emitters, self._limits.is_lamp == 0, self._limits.is_soft > 0, device)
        self._shadows = EmitterShadows(scene, self.shapes, self._limits, fog, cutouts)
        self._maps = PictureMaps(emitters.pictures, emitters.cells, device) if emitters.pictures else None
        self._divide()

    def through_glass(self, scene: RenderScene) -> EmitterLight:
        """The light that goes straight through glass."""
        light = copy.copy(self)
        light._shadows = self._shadows.through_glass(scene, self._limits)
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
        shapes = self.shapes
        corners, radii, radiance, position, is_near = (x.cpu().numpy() for x in (
            shapes.corners, shapes.radii, self.radiance, shapes.origins, ~shapes.is_distant))
        silhouette = np.concatenate([np.linalg.norm(outline_vectors(corners), axis=1), 2 * np.pi * radii**2])
        power = (silhouette * radiance.mean(axis=1))[is_near]
        return NearEmitters(position[is_near], power / max(power.sum(), 1e-20))

    def strongest_lamps(self, most: int) -> tuple[list[EmitterLight], EmitterLight]:
        """Each of the strongest emitters that are no suns by itself, and all others, in whose places those are dark."""
        near = torch.nonzero(~self.shapes.is_distant)[:, 0].cpu().numpy()
        chosen = near[np.argsort(-self.near().power_share, kind="stable")[:most]]
        return [self._alone(row) for row in chosen], self._reaching(~np.isin(np.arange(len(self)), chosen))

    def _alone(self, row: int) -> EmitterLight:
        """One emitter."""
        one, own = copy.copy(self), slice(row, row + 1)
        one.radiance, one._maps = self.radiance[own], None
        one.shapes = self.shapes.alone(row)
        one._shadows = self._shadows.alone(row, one.shapes)
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
        direction, sine2, in_beam = self.shapes.directions(x, n)
        cosine = cosines(direction, n)
        lobes = [self.shapes.form_factor(x, n, cosine, sine2) * in_beam]
        if gloss:  # of one emitter any lobe has the same share
            lobes.append(self.shapes.glossy(x, n, direction, sine2, *gloss) * in_beam if len(self) > 1
                         else torch.ones_like(in_beam))
        visible = self._shadows.visible(origin, n, start, lobes[0] > 0, direction)
        share, power = visible.mean(-1), lobes[0] * self._to_diffuse.mean(1)
        spread2 = (power.square() * share * (1 - share)).sum(1, keepdim=True).clamp_min(0)
        disagreement = 2 * spread2.sqrt() / power.sum(1, keepdim=True).clamp_min(1e-12)
        return *(_arriving(lobe, visible, radiance) / (lobe @ radiance).clamp_min(1e-12)
                 for lobe, radiance in zip(lobes, (self._to_diffuse, self._to_glossy))), disagreement

    def mirrored_visibility(self, visible: Tensor, x: Tensor, n: Tensor, v: Tensor, roughness: Tensor,
                            footprint: Tensor | None = None) -> Tensor:
        """(P, 3) visibility of what glossy lobes show, which is `visible` (P, 3) by rays to places all over emitters.

        Polished surfaces show one place of a large emitter, and what is before that alone: rays go along their lobes.
        Arguments as of `lobes`.
        """
        polished = ((DULL - roughness) / (DULL - POLISHED)).clamp(0, 1)
        if footprint is not None:  # rays go all over what a pixel mirrors
            roughness = widened(roughness, mirrored_turn2(footprint).clamp(max=1))
        casts, shines = self._shadows.casts_shadows, self._to_glossy.any(1)
        point = ((polished > 0) & (dot(n, v) > 0)).nonzero()[:, 0]
        if not len(point) or not (casts & shines).any():
            return visible
        x, n, v, polished = x[point], n[point], v[point], polished[point, None]
        ray = ggx_directions(n, v, roughness[point], LOBE_RAYS, hashed_starts(x, 2))[0].flatten(0, 1)
        origin = (x + LIFT * n).repeat_interleave(LOBE_RAYS, 0)
        emitter, distance = self.shapes.met_by(origin, ray, shines & casts)
        met = (emitter >= 0).nonzero()[:, 0]
        weight, arriving = torch.zeros_like(ray), torch.zeros_like(ray)
        weight[met] = self._to_glossy[emitter[met]]
        along_lobe = origin[met], ray[met], distance[met]
        arriving[met] = (weight[met] * self._shadows.arriving(emitter[met], *along_lobe)
                         * self._shadows.through_media(origin[met], origin[met] + distance[met, None] * ray[met]))
        weight, arriving = (values.unflatten(0, (-1, LOBE_RAYS)) for values in (weight, arriving))
        share = (weight.amax(2) > 0).float().mean(1, keepdim=True) * polished
        along = arriving.sum(1) / weight.sum(1).clamp_min(1e-12)
        return visible.index_put((point,), torch.lerp(visible[point], along, share))

    def may_pass_glass(self, x: Tensor) -> Tensor:
        """(P,) bool: whether glass may be before any emitter at points x (P, 3); of `through_glass` alone."""
        return self._shadows.may_pass_glass(x)

    def highlights(self, x: Tensor, n: Tensor, start: Tensor, *gloss: Tensor) -> Tensor:
        """(P, 3) radiance of the emitters that white glossy lobes send on, past what is in the way.

        Arguments as of `visibility`; shadow rays go to the emitters alone that the lobe of a point shows.
        """
        direction, sine2, in_beam = self.shapes.directions(x, n)
        lobe = self.shapes.glossy(x, n, direction, sine2, *gloss) * in_beam
        power = lobe * self._to_glossy.mean(1)
        is_shown = power > DIM * power.amax(1, keepdim=True)
        visible = self._shadows.visible(x[:, None], n, start, is_shown, direction)
        return _arriving(lobe * is_shown, visible, self._to_glossy)

    def radiance_in_air(self, x: Tensor) -> Tensor:
        """(P, 3) radiance that arrives in the air at points x (P, 3), the mean over all directions."""
        direction, sine2, in_beam = self.shapes.directions(x)
        is_lit = (in_beam > 0) & self._to_air.any(1)
        visible = self._shadows.visible(x[:, None], None, hashed_starts(x, 2)[:, None], is_lit, direction)
        return _arriving(sine2 / 4 * in_beam, visible, self._to_air)

    def unshadowed_in_air(self, x: Tensor) -> Tensor:
        """The same without what is in the way."""
        _, sine2, in_beam = self.shapes.directions(x)
        return (sine2 / 4 * in_beam) @ self._to_air

    def diffuse(self, x: Tensor, n: Tensor, *layer: Tensor) -> tuple[Tensor, ...]:
        """Unshadowed radiance (P, 3) leaving a white diffuse surface at points x (P, 3) with unit normals n (P, 3).

        With f0 and roughness (P,) of a dielectric `layer` also the same light as the layer weighs it, relative to what
        it would reflect of light from everywhere, so that its mean albedo can be multiplied with it; and the unit
        vectors to emitters (P, 3), times the mean of its channels.
        """
        direction, form_factor = self.shapes.form_factors(x, n)
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
        direction, sine2, in_beam = self.shapes.directions(x, n)
        form_factor = self.shapes.form_factor(x, n, cosines(direction, n), sine2) * in_beam
        power, emitter = (form_factor * self._to_diffuse.mean(1)).topk(min(STRONGEST, len(self)), dim=1)
        point = torch.arange(len(x), device=x.device)[:, None]
        complete = (form_factor @ self._to_diffuse + other).clamp_min(1e-12)
        distance = length(self.shapes.origins[emitter] - x[:, None])
        nearness = ~self.shapes.is_distant[emitter] / (1 + distance)
        share = form_factor[point, emitter][..., None] * self._to_diffuse[emitter] / complete[:, None]
        parts = {"toward": direction[:, point, emitter].movedim(0, -1), "nearness": nearness[..., None],
                 "sine": sine2[point, emitter].sqrt()[..., None], "share": share}
        found = torch.cat([parts[name] for name in EMITTER.parts], -1) * (power > 0)[..., None]
        result[:, :found.shape[1]] = found
        return result

    def sheen(self, x: Tensor, n: Tensor, stretch: Tensor, lean: Tensor) -> tuple[Tensor, Tensor]:
        """Unshadowed radiance (P, 3) leaving a white diffuse surface and a white sheen (material/sheen.py).

        stretch: (P,); lean: (P, 3), along the surface.
        """
        direction, sine2, in_beam = self.shapes.directions(x, n)
        cosine = cosines(direction, n)
        of_diffuse = self.shapes.form_factor(x, n, cosine, sine2)
        of_sheen = sheen_form_factor(cosine, sine2, stretch[:, None], lean, direction)
        return (of_diffuse * in_beam) @ self._to_diffuse, (of_sheen * in_beam) @ self._to_diffuse

    def lobes(self, x: Tensor, n: Tensor, *gloss: Tensor) -> tuple[Tensor, Tensor]:
        """Unshadowed radiance (P, 3) leaving a white diffuse and a white glossy lobe; arguments as of `visibility`.

        A footprint (P, 2, 9) may follow (footprints.py).
        """
        if not len(self):
            return torch.zeros_like(x), torch.zeros_like(x)
        direction, sine2, in_beam = self.shapes.directions(x, n)
        cosine = cosines(direction, n)
        diffuse = self.shapes.form_factor(x, n, cosine, sine2) * in_beam
        glossy = self.shapes.glossy(x, n, direction, sine2, *gloss) * in_beam
        return diffuse @ self._to_diffuse, glossy @ self._to_glossy + self._detail(glossy, x, n, *gloss)

    def _detail(self, share: Tensor, x: Tensor, n: Tensor, v: Tensor, roughness: Tensor, f0: Tensor,
                footprint: Tensor | None = None) -> Tensor | float:
        """(P, 3) what pictures show beyond the means of their cells in lobes that have shares (P, E) of emitters."""
        if self._maps is None:
            return 0.0
        turn2 = torch.zeros_like(roughness) if footprint is None else mirrored_turn2(footprint)
        shown, by_maps = self._maps.shown(x, n, v, roughness, turn2)
        last = slice(len(self.shapes.corners) - by_maps.shape[1] * self._maps.cells, len(self.shapes.corners))
        cells = share[:, last].unflatten(1, (-1, self._maps.cells))
        means = self._to_glossy[last].unflatten(0, cells.shape[1:])
        shines = means.flatten(1).any(1)
        difference = cells.sum(2)[..., None] * shown - torch.einsum("pkc,kcj->pkj", cells, means)
        return (difference * (by_maps * shines)[..., None]).sum(1)

    def sample(self, x: Tensor, n: Tensor, start: Tensor) -> tuple[Tensor, Tensor]:
        """One emitter for each point x (P, 3), chosen in proportion to its unshadowed light there.

        Returns the vector to it (P, 3), a direction for suns, and the radiance (P, 3) that a white diffuse surface with
        the unit normal n (P, 3) would send on if all light came from there, on whichever side is lit. start: (P, 2) in
        [0, 1).
        """
        direction, form_factor = self.shapes.form_factors(x, n)
        form_factor = form_factor + self.shapes.form_factors(x, -n)[1]
        radiance = self._through_glass
        power = (form_factor * radiance.mean(1)).cumsum(1)
        threshold = power[:, -1:] * start.sum(1, keepdim=True).frac()
        emitter = torch.searchsorted(power, threshold, right=True)[:, 0].clamp(max=form_factor.shape[1] - 1)
        point = torch.arange(len(x), device=x.device)
        on_emitter = self.shapes.points_on(emitter, direction[:, point, emitter].T, start)
        color = radiance[emitter] / radiance[emitter].mean(1, keepdim=True).clamp_min(1e-20)
        return on_emitter - x * ~self.shapes.is_distant[emitter, None], color * power[:, -1:]


def _arriving(weight: Tensor, visible: Tensor, radiance: Tensor) -> Tensor:
    """(P, 3) sum of radiance (E, 3) by weights (P, E), of which a share (P, E, 1) or (P, E, 3) arrives."""
    if visible.shape[2] == 1:
        return (weight * visible[..., 0]) @ radiance
    return torch.einsum("pe,pec,ec->pc", weight, visible, radiance)
