# SPDX-License-Identifier: GPL-3.0-or-later
"""What is in the way of emitters' light, by shadow rays.

Shapes: P points, E emitters. All lengths are in network units. Vectors to emitters are planes (3, P, E), as in
form_factors.py.
"""
from __future__ import annotations

import copy

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from ...scene import RenderScene
from ...scene_rays import scene_rays
from ...surface_kinds import BENDING, OCCLUDING, SHADING, Kind, Ray
from ..cutouts import Cutouts
from ..media.transmittance import Fog
from ..sampling import R2, hashed_starts
from ..tensor_rays import TensorRays
from ..vectors import dot, length, unit
from .emitter_shapes import LEAST_COSINE, EmitterShapes
from .emitters import ROUND, Limits
from .environment_light import LIFT
from .straight_glass import StraightGlass
from .terminator import start_heights

FOG_REACH = 3.0  # network units from the centre: fog beyond dims no emitter
CHOICES = 4      # places on an emitter for the rays of a point to it, if these are fewer
FARTHEST = 4.0   # network units between surfaces and glass at most: so far the light of a sun spreads
END_GAP = 4e-3   # network units before a surface that shines at which a shadow ray ends: emitters stand for it
OF_ALL = ("_before", "_occluder", "casts_shadows")  # fields of EmitterShadows that have a row for each emitter


class EmitterShadows:
    """What stands between emitters and surfaces: occluders, cutouts, fog."""

    def __init__(self, scene: RenderScene, shapes: EmitterShapes, limits: Limits, fog: Fog | None,
                 cutouts: Cutouts | None):
        device = shapes.origins.device
        self._shapes, self._fog, self._cutouts = shapes, fog, cutouts
        self._glass = None  # that light must pass
        self.casts_shadows = torch.as_tensor(limits.blockers > 0, device=device)
        # What shines to one side is at the place of its surface, lumps and spheres stand for one around them.
        self._before = torch.where(shapes.beam_axis.any(1), END_GAP, ROUND * shapes.reach)
        self._shining = None
        if shapes.is_surface.sum() > 1:
            self._shining = TensorRays(scene_rays(scene).among(Kind.EMITTER, Ray.SHADOW))
        self._occluders, self._occluder = _occluders(scene, limits, device)

    def through_glass(self, scene: RenderScene, limits: Limits) -> EmitterShadows:
        """Those of the light that goes straight through glass."""
        shadows, device = copy.copy(self), self._before.device
        shadows._glass = StraightGlass.of(scene, device)
        shadows._occluders, shadows._occluder = _occluders(scene, limits, device, BENDING)
        return shadows

    def alone(self, row: int, shape: EmitterShapes) -> EmitterShadows:
        """Those of one emitter, which has that shape alone."""
        one = copy.copy(self)
        one._shapes = shape
        for name in OF_ALL:
            setattr(one, name, getattr(self, name)[row:row + 1])
        return one

    def may_pass_glass(self, x: Tensor) -> Tensor:
        """As EmitterLight.may_pass_glass."""
        ray = self._shapes.origins - x[:, None] * ~self._shapes.is_distant[:, None]
        distance = length(ray)
        width = self._shapes.reach * (FARTHEST / distance.clamp_min(1e-9)).clamp(max=1)
        return self._glass.around.is_near(x[:, None], unit(ray), distance, width).any(1)

    def visible(self, origin: Tensor, n: Tensor | None, start: Tensor, is_lit: Tensor, direction: Tensor) -> Tensor:
        """(P, E, 1) or (P, E, 3) share of each emitter's light that arrives at P points, where `is_lit` (P, E).

        By K rays each, which count by the light that comes from where they end. origin: as of EmitterLight.visibility,
        or (P, 1, ...); n: (P, 3) unit normals, below whose horizon no ray goes, or none of points in the air; start:
        (P, K, 2), where on emitters the rays end; direction: (3, P, E), to the emitters.
        """
        origin, *curved = origin.split(3, 2)
        point, emitter = (is_lit & self.casts_shadows).nonzero().unbind(1)
        toward, raised = direction[:, point, emitter].T, 0.0
        if curved:  # of a point all rays have the same
            face, up = (x[:, 0] for x in curved)
            raised = start_heights(direction, face, n)[point, emitter, None] * up[point]
        above = None if n is None else n[point]
        arrived = total = 0.0
        for x, on_emitter in zip(origin.expand(-1, start.shape[1], -1).unbind(1), start.unbind(1), strict=True):
            begin = (x if n is None else x + LIFT * n)[point] + raised
            ray, weight = self._toward(emitter, begin, toward, on_emitter[point], above, CHOICES // start.shape[1])
            distance = length(ray)
            arrives = self.arriving(emitter, begin, ray / distance.clamp_min(1e-9)[:, None], distance)
            arrived, total = arrived + weight * arrives, total + weight
        visible = total.new_zeros(*is_lit.shape, arrived.shape[1]).index_put((point, emitter), arrived / total)
        visible = visible * self.through_media(origin.mean(1, keepdim=True), self._shapes.origins)
        return torch.where(self.casts_shadows[:, None], visible, is_lit[..., None])

    def _toward(self, emitter: Tensor, origin: Tensor, direction: Tensor, start: Tensor, n: Tensor | None,
                choices: int) -> tuple[Tensor, Tensor]:
        """Vectors (R, 3) from points (R, 3) to places on emitters (R,), and (R, 1) how much light comes from there.

        One place of `choices` each, if there are several, as often as light comes from there, which then counts as
        their mean (resampled importance sampling, Talbot et al. 2005). direction, n: (R, 3); start: (R, 2).
        """
        chosen, total = self._to_place(emitter, origin, direction, start, n)
        for choice in range(1, choices):
            start = (start + torch.tensor(R2, device=start.device)) % 1
            ray, weight = self._to_place(emitter, origin, direction, start, n)
            total = total + weight
            is_chosen = hashed_starts(F.pad(start, (0, 1), value=choice), 1) * total < weight
            chosen = torch.where(is_chosen, ray, chosen)
        return chosen, total / max(choices, 1)

    def _to_place(self, emitter: Tensor, origin: Tensor, direction: Tensor, start: Tensor,
                  n: Tensor | None) -> tuple[Tensor, Tensor]:
        """The same for one place."""
        origin = origin * ~self._shapes.is_distant[emitter, None]
        ray = self._shapes.points_on(emitter, direction, start) - origin
        if n is None:
            return ray, self._shapes.falloff(emitter, ray)[:, None]
        ray = _above_horizon(ray, self._shapes.origins[emitter] - origin, n)
        cosine = dot(ray, n) / length(ray).clamp_min(1e-9)
        return ray, (self._shapes.falloff(emitter, ray) * cosine.clamp_min(LEAST_COSINE))[:, None]

    def arriving(self, emitter: Tensor, origin: Tensor, ray: Tensor, distance: Tensor) -> Tensor:
        """(R, 1) or (R, 3) share of the light of emitters (R,) that comes through what is solid, glass or a card, along
        rays (R, 3) of unit vectors from points (R, 3), so far (R,) from them."""
        is_surface = self._shapes.is_surface[emitter]
        # No surface is at the place of a lamp, whose housing may be close.
        end = distance - torch.where(is_surface, END_GAP, LIFT)
        is_blocked = self._is_blocked(emitter, origin, ray, end)
        if self._shining is not None:
            # Shells that are seen from outside would hide themselves: lumps that stand for them lie below.
            faces = is_surface & (dot(self._shapes.outward[emitter], ray) >= 0)
            others = (~is_blocked & faces).nonzero()[:, 0]
            is_blocked[others] = self._shining.is_blocked(
                *(rays[others] for rays in (origin, ray, distance - self._before[emitter])))
        arrives = 1.0 * ~is_blocked[:, None]
        if self._glass is not None:
            arrives = arrives * self._glass.transmittance(origin, ray, end * arrives[:, 0])
        if self._cutouts is not None:
            arrives = arrives * self._cutouts.transmittance(origin, ray, end * (arrives.amax(1) > 0))
        return arrives

    def through_media(self, begin: Tensor, end: Tensor) -> Tensor | float:
        """(..., C) share of light that media leave between points (..., 3) and places (E, 3) on emitters."""
        return 1.0 if self._fog is None else self._fog.transmittance(begin, end.renorm(2, 0, FOG_REACH))

    def _is_blocked(self, emitter: Tensor, *rays: Tensor) -> Tensor:
        """(R,) bool of rays to emitters (R,), as TensorRays.is_blocked has them."""
        if len(self._occluders) == 1:
            return self._occluders[0].is_blocked(*rays)
        is_blocked, occluder = torch.zeros_like(emitter, dtype=torch.bool), self._occluder[emitter]
        for i, occluders in enumerate(self._occluders):
            rows = (occluder == i).nonzero()[:, 0]
            is_blocked[rows] = occluders.is_blocked(*(x[rows] for x in rays))
        return is_blocked


def _occluders(scene: RenderScene, limits: Limits, device: torch.device | str,
               passed: int = 0) -> tuple[list[TensorRays], Tensor]:
    """What stops the light of emitters (E,) of some limits, and which of it is that of each, (E,) i64.

    Surfaces that shine stop that of lamps alone: no emitter shades itself. passed: what stops none.
    """
    kinds, occluder = np.unique(np.stack([limits.blockers, limits.is_lamp], 1), axis=0, return_inverse=True)
    rays = scene_rays(scene)
    return [TensorRays(rays.among((SHADING if is_lamp else OCCLUDING) & ~passed, Ray.SHADOW, int(groups)))
            for groups, is_lamp in kinds], torch.as_tensor(occluder.reshape(-1), device=device)


def _above_horizon(ray: Tensor, middle: Tensor, n: Tensor) -> Tensor:
    """Vectors (R, 3) to emitters, those below the horizon of unit normals (R, 3) mirrored at their middle (R, 3).

    Form factors are of what is above it alone, and so is what is visible of that.
    """
    ray = torch.where(dot(ray, n)[:, None] < 0, 2 * middle - ray, ray)
    return ray - dot(ray, n).clamp(max=0)[:, None] * n
