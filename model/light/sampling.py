# SPDX-License-Identifier: GPL-3.0-or-later
"""Directions and points that are as dense as a lobe, from sequences that fill evenly, alone and together."""
from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn import functional as F

GOLDEN = (math.sqrt(5) - 1) / 2
R2 = 0.7548776662, 0.5698402910  # steps of a sequence that fills a square evenly (Roberts 2018)
MIX, SCATTER = [(1298.98, 2695.31, 3119.2), (7823.3, 1833.06, 911.7), (3771.9, 2461.7, 6011.4)], 43758.5453


def in_a_row(number: Tensor) -> Tensor:
    """(P, 2) in [0, 1) of points by number (P,): where the samples of neighbours go between each other's."""
    return number[:, None] * torch.tensor(R2, device=number.device) % 1


def scattered(position: Tensor, count: int) -> Tensor:
    """(P, count) f32 in [0, 1), as if at random, but the same wherever a point (P, 3) stands among others."""
    mixed = position.cpu().double() @ torch.tensor(MIX, dtype=torch.float64)[:, :count]  # GPUs may know no float64
    return (mixed.sin() * SCATTER % 1).float().to(position.device)


def cosine_directions(normal: Tensor, count: int, start: Tensor) -> Tensor:
    """(P, count, 3) unit vectors around unit normals (P, 3), as dense as their cosines; `start` (P, 2) in [0, 1)."""
    k = torch.arange(count, device=normal.device)
    sine2 = (k + start[:, :1]) / count
    phi = 2 * math.pi * ((k * GOLDEN + start[:, 1:]) % 1)
    sine = sine2.sqrt()
    return torch.stack([sine * phi.cos(), sine * phi.sin(), (1 - sine2).clamp_min(1e-4).sqrt()], -1) @ _axes(normal)


def ggx_directions(normal: Tensor, outgoing: Tensor, roughness: Tensor, count: int,
                   start: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """(P, count, 3) unit vectors that a GGX surface reflects towards `outgoing` (P, 3).

    And (P, count) weights, whose mean is the share of light from everywhere that facets without loss would reflect;
    cosines at which the facets are met; and by how much the vectors are dense, by solid angle. The normals of the
    facets are as dense as their share of the surface (Walter et al. 2007, equation 35); normal (P, 3), roughness (P,),
    `start` (P, 2) as above.
    """
    alpha2 = roughness.clamp_min(0.05)[:, None] ** 4
    k = torch.arange(count, device=normal.device)
    u = (k + start[:, :1]) / count
    phi = 2 * math.pi * ((k * GOLDEN + start[:, 1:]) % 1)
    cosine = ((1 - u) / (1 + (alpha2 - 1) * u)).clamp(0, 1).sqrt()
    sine = (1 - cosine.square()).sqrt()
    half = torch.stack([sine * phi.cos(), sine * phi.sin(), cosine], -1) @ _axes(normal)
    towards = (half * outgoing[:, None]).sum(-1).clamp_min(0)
    direction = F.normalize(2 * towards[..., None] * half - outgoing[:, None], dim=-1)
    leaving = (direction * normal[:, None]).sum(-1).clamp_min(0)
    seen = (outgoing * normal).sum(-1, keepdim=True).abs().clamp_min(1e-3)
    into, out = (x * (alpha2 + (1 - alpha2) * y.square()).sqrt() for x, y in ((leaving, seen), (seen, leaving)))
    unmasked = 2 * leaving / (into + out).clamp_min(1e-6)
    density = alpha2 * cosine / (4 * math.pi * (cosine.square() * (alpha2 - 1) + 1).square() * towards.clamp_min(1e-3))
    return direction, unmasked * towards / cosine.clamp_min(1e-3), towards, density


def triangle_weights(u: Tensor, v: Tensor) -> Tensor:
    """(..., 3) barycentric weights, of points evenly dense for u, v (...) in [0, 1)."""
    u = u.sqrt()
    return torch.stack([1 - u, u * (1 - v), u * v], dim=-1)


def disk_points(normal: Tensor, u: Tensor, v: Tensor) -> Tensor:
    """(P, 3) points, evenly dense for u, v (P,) in [0, 1), of unit disks across unit vectors (P, 3)."""
    radius, phi = u.sqrt(), 2 * math.pi * v
    flat = torch.stack([radius * phi.cos(), radius * phi.sin(), torch.zeros_like(u)], dim=-1)
    return (flat[:, None] @ _axes(normal))[:, 0]


def _axes(normal: Tensor) -> Tensor:
    """(P, 3, 3) two unit vectors across a unit normal (P, 3), and itself (Duff et al. 2017)."""
    x, y, z = normal.unbind(-1)
    sign = torch.where(z < 0, -1.0, 1.0)
    a = -1 / (sign + z)
    b = x * y * a
    aside = torch.stack([1 + sign * x * x * a, sign * b, -sign * x], -1)
    return torch.stack([aside, torch.stack([b, sign + y * y * a, -y], -1), normal], 1)
