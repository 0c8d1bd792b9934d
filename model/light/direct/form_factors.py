# SPDX-License-Identifier: GPL-3.0-or-later
"""How much of emitters' light surfaces send on, in closed form.

An emitter enters by its vector form factor, which a sphere of the same solid angle replaces for the horizon (Snyder
1996, "Area light sources for real-time graphics"; Heitz and Hill 2017, "Real-time line- and disk-light shading").
Vectors of P points and E emitters are planes (3, P, E), which PyTorch adds up much faster than the last axis of
(P, E, 3).
"""
from __future__ import annotations

import math

import torch
from torch import Tensor

from ...beams import SPREAD
from ..vectors import cross, dot, length, unit

BLUR = 1.25  # of beams by emitters, which reaches the middle of the next one of a grid of them
MOST_SINE2 = 0.999  # of an emitter that fills half of what is seen
TIP, EDGE = 0.67, 0.87  # mean and deviation of a disk's points, in radii, to where a cone is sharp
EDGE_BLUR = 2.24  # of a beam's edge by the emitter: width of a smooth step that deviates as much as a disk of radius 1


def polygon_directions(corners: Tensor, x: Tensor) -> tuple[Tensor, Tensor]:
    """Unit direction (3, P, E) to polygons (E, K, 3) from points (3, P, E), and its squared angular sine (P, E).

    By Lambert's formula, from both sides of the polygons.
    """
    rays = [unit(corner[:, None] - x, 0) for corner in corners.permute(1, 2, 0)]
    vector = torch.zeros_like(x)
    for ray, following in zip(rays, (*rays[1:], *rays[:1]), strict=True):
        edge = cross(ray, following, 0)
        sine = length(edge, 0)
        vector += edge * (torch.atan2(sine, dot(ray, following, 0)) / sine.clamp_min(1e-6))
    size = length(vector, 0)
    facing = dot(vector, sum(rays), 0).sign()
    return vector * (facing / size.clamp_min(1e-19)), size / (2 * math.pi)


def sphere_directions(centers: Tensor, radii: Tensor, beyond2: Tensor, x: Tensor) -> tuple[Tensor, Tensor]:
    """The same of spheres, centers (E, 3), radii (E,), and of disks that face each point.

    beyond2: (E,) added to squared distances: 0 of spheres, radii^2 of disks, which look as large as their rims.
    """
    ray = centers.T[:, None] - x
    distance2 = dot(ray, ray, 0)
    return ray / distance2.clamp_min(1e-20).sqrt(), radii**2 / torch.maximum(distance2 + beyond2, radii**2)


def cosines(direction: Tensor, vector: Tensor) -> Tensor:
    """(P, E) of directions (3, P, E) and vectors (P, 3) of the points."""
    return dot(direction, vector.T[..., None], 0)


def beam(direction: Tensor, sine2: Tensor, axis: Tensor, cosine: Tensor) -> Tensor:
    """(P, E) share of radiance that emitters send along `direction` within the cones of their beams.

    Either smooth ones or those of area lamps with a spread (model/beams.py).
    An emitter that looks large, by its squared sine (P, E), blurs the edge of its cone. One that looks larger than the
    cone's core blurs all of it: that is wider and as much dimmer, so that emitters side by side light what lies before
    them evenly.
    axis: (E, 3), 0 for emitters without a beam, whose share is 1; cosine: (E, 2), of the cone's rim and core.
    """
    toward = -dot(direction, axis.T[:, None], 0)
    is_spread = cosine[:, 1] == SPREAD
    share = _smooth_share(toward, sine2, *cosine.unbind(1))
    if is_spread.any():
        share = torch.where(is_spread, _spread_share(toward, sine2, cosine[:, 0]), share)
    return share.where(axis.square().sum(-1) > 0.25, 1.0)


def _smooth_share(toward: Tensor, sine2: Tensor, rim: Tensor, core: Tensor) -> Tensor:
    core_sine2 = (1 - core.square()).clamp_min(0) * (rim > 0)  # what is before a flat light ends sharply
    beyond = (sine2.sqrt() - core_sine2.sqrt()).clamp_min(0)
    wider = 1 + BLUR * beyond.square() * rim.clamp_min(0) / (1 - rim).clamp_min(1e-6)
    width = (core - rim).clamp_min(1e-6)
    blurred = (width.square() + EDGE_BLUR ** 2 * sine2 * core_sine2).sqrt().minimum(2 - core - rim)
    edge = (blurred - width).clamp_min(0) / 2  # at either side
    t = (toward - rim + edge + (1 - toward) * (1 - 1 / wider)) / (width + 2 * edge)
    t = t.clamp(0, 1)
    return t * t * (3 - 2 * t) / wider


def _spread_share(toward: Tensor, sine2: Tensor, border: Tensor) -> Tensor:
    """What falls linearly in the tangent, to 0 at a border's cosine (E,), as the mean over an emitter.

    That is a disk in the plane of tangents. A cone narrower than the disk is as wide, and as much dimmer.
    """
    cosine = toward.clamp_min(1e-3)
    radius = (sine2 / cosine ** 3).sqrt()
    tangent = ((1 - cosine.square()).clamp_min(0) / cosine.square() + (TIP * radius).square()).sqrt()
    border = (1 - border.square()).clamp_min(0).sqrt() / border.clamp_min(1e-6)
    wider = torch.maximum(border.expand_as(radius), 2 * radius)
    within, edge = wider - tangent, (EDGE * radius).clamp_min(1e-9)
    share = torch.where(within < edge, (within + edge).clamp_min(0).square() / (4 * edge), within) / wider
    return share * (border / wider).square() * (toward > 0)


def sheen_form_factor(cosine: Tensor, sine2: Tensor, stretch: Tensor, lean: Tensor, direction: Tensor) -> Tensor:
    """The same of directions (3, P, E) that are transformed (material/sheen.py): what a white sheen sees.

    stretch: (P, 1), their scale across the normal; lean: (P, 3), what is added for each unit along it.
    """
    along = stretch * cosines(direction, lean) + dot(lean, lean)[:, None] * cosine / 2
    length2 = stretch.square() * (1 - cosine.square()) + cosine.square() + 2 * cosine * along
    larger = stretch.square() * length2 ** -1.5  # solid angles
    return sphere_form_factor(cosine * length2.rsqrt(), (sine2 * larger).clamp_max(MOST_SINE2))


def sphere_form_factor(cosine: Tensor, sine2: Tensor) -> Tensor:
    """Share of the hemisphere's projected solid angle that a sphere covers, cut by the horizon.

    cosine between the normal and the sphere's centre; sine2 = (radius / distance)^2 < 1. Same shapes in and out.
    """
    above = cosine.clamp_min(0) * sine2
    cut = (sine2 - cosine.square()).clamp_min(0)  # > 0 where the horizon cuts the sphere
    root = (cut * (1 - sine2)).clamp_min(1e-20).sqrt()
    edge = (-cosine * ((1 - sine2) / (sine2 * (1 - cosine.square())).clamp_min(1e-12)).sqrt()).clamp(-1, 1)
    partial = (sine2 * cosine * torch.acos(edge) - root + torch.atan(cut.sqrt() / (1 - sine2).sqrt())) / math.pi
    return torch.where(cut > 0, partial.clamp_min(0), above)
