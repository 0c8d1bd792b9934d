# SPDX-License-Identifier: GPL-3.0-or-later
"""Low-discrepancy directions and points, distributed like a lobe; neighbours' samples fill each other's gaps."""
from __future__ import annotations

import math

import torch
from torch import Tensor

from .vectors import dot, unit

GOLDEN = (math.sqrt(5) - 1) / 2
R2 = 0.7548776662, 0.5698402910  # steps of the R2 sequence (Roberts 2018)
MIX, SCATTER = [(1298.98, 2695.31, 3119.2), (7823.3, 1833.06, 911.7), (3771.9, 2461.7, 6011.4)], 43758.5453


def r2_starts(number: Tensor) -> Tensor:
    """(P, 2) in [0, 1) of points by number (P,): consecutive numbers get starts that are far apart."""
    return number[:, None] * torch.tensor(R2, device=number.device) % 1


def hashed_starts(position: Tensor, count: int) -> Tensor:
    """(P, count) f32 in [0, 1), pseudo-random by the position (P, 3) of each point alone."""
    mixed = position.cpu().double() @ torch.tensor(MIX, dtype=torch.float64)[:, :count]  # GPUs may know no float64
    return (mixed.sin() * SCATTER % 1).float().to(position.device)


def cosine_directions(normal: Tensor, count: int, start: Tensor) -> Tensor:
    """(P, count, 3) unit vectors around unit normals (P, 3), denser by the cosine; start: (P, 2) in [0, 1)."""
    k = torch.arange(count, device=normal.device)
    sine2 = (k + start[:, :1]) / count
    phi = 2 * math.pi * ((k * GOLDEN + start[:, 1:]) % 1)
    sine = sine2.sqrt()
    cosine = (1 - sine2).clamp_min(1e-4).sqrt()
    return torch.stack([sine * phi.cos(), sine * phi.sin(), cosine], -1) @ local_basis(normal)


def ggx_directions(normal: Tensor, outgoing: Tensor, roughness: Tensor, count: int,
                   start: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Unit vectors (P, count, 3) from which a GGX surface reflects light towards `outgoing` (P, 3).

    normal: (P, 3) unit; roughness: (P,), perceptual; start: (P, 2) in [0, 1). Facet normals are distributed as the
    viewer sees them (Heitz 2018, in the form of Dupuy and Benyoub 2023). Also returns, (P, count) each: weights, whose
    mean is the share of uniform light that lossless facets reflect; the cosine at which light meets the facets; and the
    density by solid angle.
    """
    alpha = roughness.clamp_min(0.05)[:, None].square()
    alpha2, basis = alpha.square(), local_basis(normal)
    x, y, viewer = (basis @ outgoing[..., None])[..., 0].split(1, 1)
    viewer = viewer.abs().clamp_min(1e-3)
    outgoing = unit(torch.cat([x, y, viewer], 1))[:, None]
    stretch = torch.cat([alpha, alpha, torch.ones_like(alpha)], 1)[:, None]
    seen_from = unit(outgoing * stretch)  # by facets that are distributed as on a sphere
    k = torch.arange(count, device=normal.device)
    cosine = 1 - (k + start[:, :1]) / count * (1 + seen_from[..., 2])
    phi, sine = 2 * math.pi * ((k * GOLDEN + start[:, 1:]) % 1), (1 - cosine.square()).clamp_min(0).sqrt()
    facet = torch.stack([sine * phi.cos(), sine * phi.sin(), cosine], -1) + seen_from
    facet = unit(facet * stretch)
    facet_cosine = dot(facet, outgoing).clamp_min(0)
    direction = unit(2 * facet_cosine[..., None] * facet - outgoing)
    leaving, root = direction[..., 2].clamp_min(0), smith_root(viewer, alpha2)
    weight = leaving * (viewer + root) / (leaving * root + viewer * smith_root(leaving, alpha2)).clamp_min(1e-6)
    density = alpha2 / (2 * math.pi * (viewer + root) * (facet[..., 2].square() * (alpha2 - 1) + 1).square())
    return direction @ basis, weight, facet_cosine, density


def smith_root(cosine: Tensor, alpha2: Tensor) -> Tensor:
    """The root in Smith's height-correlated masking and shadowing of GGX facets (Heitz 2014)."""
    return (alpha2 + (1 - alpha2) * cosine.square()).sqrt()


def triangle_weights(u: Tensor, v: Tensor) -> Tensor:
    """(..., 3) barycentric weights, of points that cover a triangle evenly for u, v (...) in [0, 1)."""
    u = u.sqrt()
    return torch.stack([1 - u, u * (1 - v), u * v], dim=-1)


def disk_points(normal: Tensor, u: Tensor, v: Tensor) -> Tensor:
    """(P, 3) points that cover unit disks across unit vectors (P, 3) evenly for u, v (P,) in [0, 1)."""
    radius, phi = u.sqrt(), 2 * math.pi * v
    flat = torch.stack([radius * phi.cos(), radius * phi.sin(), torch.zeros_like(u)], dim=-1)
    return (flat[:, None] @ local_basis(normal))[:, 0]


def local_basis(normal: Tensor) -> Tensor:
    """(P, 3, 3) orthonormal basis of two tangents and the unit normal (P, 3) (Duff et al. 2017)."""
    x, y, z = normal.unbind(-1)
    sign = torch.where(z < 0, -1.0, 1.0)
    a = -1 / (sign + z)
    b = x * y * a
    aside = torch.stack([1 + sign * x * x * a, sign * b, -sign * x], -1)
    return torch.stack([aside, torch.stack([b, sign + y * y * a, -y], -1), normal], 1)
