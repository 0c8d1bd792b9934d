# SPDX-License-Identifier: GPL-3.0-or-later
"""The glow of a fog around one lamp, whose falloff and beam are finer than the cells of the fog.

Along a ray the lamp is in closed form, at places that its angle spreads evenly (equi-angular sampling, Kulla and
Fajardo 2012, "Importance sampling techniques for path tracing in participating media"). How much of its light arrives,
and how much is scattered, is interpolated between the cells.
"""
from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from ..direct.emitter_light import EmitterLight
from .transmittance import Fog

PLACES = 12   # along a ray
NEAREST = 1e-3  # network units, of a ray from a lamp
MARGIN = 0.02   # of the cosine of a beam's rim, within which rays are sampled


class LampGlow:
    """What the cells of a fog scatter of the light of one lamp."""

    def __init__(self, fog: Fog, lamp: EmitterLight, arriving: Tensor):
        """lamp: one emitter; arriving: (SIDE^3, 3) share of its light that gets to each cell."""
        self._lamp, self._origin, self._axis = lamp, lamp.shapes.origins[0], lamp.shapes.beam_axis[0]
        self._rim = float(lamp.shapes.beam_cosine[0, 0]) - MARGIN
        self._fog, self._scattered = fog, fog.as_volume(arriving * fog.scattering)

    def __call__(self, origin: Tensor, direction: Tensor, begin: Tensor, end: Tensor,
                 transmittance: Callable[[Tensor], Tensor]) -> Tensor:
        """(P, 3) radiance towards points (P, 3) that is scattered along unit vectors (P, 3).

        Between the distances `begin` and `end` (P, 1). transmittance: of distances (P, K), (P, K, C).
        """
        to_lamp = self._origin - origin
        closest = (to_lamp * direction).sum(1, keepdim=True)
        beside = (to_lamp - closest * direction).norm(dim=1, keepdim=True).clamp_min(NEAREST)
        begin, end = self._within_beam(-to_lamp, direction, begin, end)
        first, last = (torch.atan((x - closest) / beside) for x in (begin, end))
        step = (last - first).clamp_min(0) / PLACES
        along = beside * (first + (torch.arange(PLACES, device=step.device) + 0.5) * step).tan()
        length = step * (along.square() + beside.square()) / beside
        distance = along + closest
        points = (origin[:, None] + distance[..., None] * direction[:, None]).flatten(0, 1)
        light = self._lamp.unshadowed_in_air(points) * self._fog.interpolated(self._scattered, points)
        return (light.view(*distance.shape, 3) * transmittance(distance) * length[..., None]).sum(1)

    def _within_beam(self, origin: Tensor, direction: Tensor, begin: Tensor, end: Tensor) -> tuple[Tensor, Tensor]:
        """The part of rays that is in the cone of the beam, whose tip origins (P, 3) are relative to."""
        if self._rim <= 0 or not self._axis.any():
            return begin, end
        # |axis . (o + t d)|^2 = rim^2 |o + t d|^2
        o, d, rim2 = origin @ self._axis, direction @ self._axis, self._rim ** 2
        a = d.square() - rim2
        b = o * d - rim2 * (origin * direction).sum(1)
        c = o.square() - rim2 * origin.square().sum(1)
        root = (b.square() - a * c).clamp_min(0).sqrt()
        a = torch.where(a.abs() < 1e-9, 1e-9, a)
        crossings = torch.stack([begin[:, 0], (-b - root) / a, (-b + root) / a, end[:, 0]], 1)
        crossings = crossings.clamp(begin, end).sort(1).values
        middles = (crossings[:, 1:] + crossings[:, :-1]) / 2
        x = origin[:, None] + middles[..., None] * direction[:, None]
        inside = (x @ self._axis > self._rim * x.norm(dim=-1)) & (crossings[:, 1:] > crossings[:, :-1])
        first = inside.int().argmax(1, keepdim=True)
        is_crossed = inside.any(1, keepdim=True)
        return tuple(torch.where(is_crossed, crossings.gather(1, first + i), begin) for i in (0, 1))
