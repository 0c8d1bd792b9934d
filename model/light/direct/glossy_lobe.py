# SPDX-License-Identifier: GPL-3.0-or-later
"""The light of an emitter that a GGX surface sends to the viewer: its own shape, size and place, however smooth it is.

Light from l reaches the viewer at v by facets across h = l + v. The distribution of facet normals is a cosine that a
linear map stretches (Heitz et al. 2016, "Real-time polygonal-light shading with linearly transformed cosines", for
which it is one without fitting), so the share of facets that show an emitter is Lambert's formula for the outline
that its directions have among those normals. What varies little over an emitter, masking and Fresnel, is that
of the mean facet. R pairs of points and emitters; vectors are planes (3, R).
"""
from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from ..fresnel import lobe_albedo, reflectance
from ..sampling import local_basis, smith_root
from ..vectors import dot, unit
from .form_factors import cosines
from .horizon import lambert_vector

LEAST_ROUGHNESS = 0.02
SMOOTH, ROUGH = 0.01, 0.1  # alpha up to which straight edges stay straight, and from which normals far off are exact
LEAST_COSINE = 1e-3
SMALL = 0.1             # squared size of an emitter over that of what the lobe shows


class FacetCosines(NamedTuple):
    """Cosines of facets that mirror the middle of E emitters at P points."""

    n_h: Tensor  # (P, E), between facet and normal
    v_h: Tensor  # (P, E), between facet and viewer
    n_l: Tensor  # (P, E), between normal and emitter
    n_v: Tensor  # (P, 1), between normal and viewer


def facet_cosines(direction: Tensor, n: Tensor, v: Tensor) -> FacetCosines:
    """FacetCosines of emitters in unit `direction` (3, P, E); n and v: (P, 3)."""
    n_l, n_v = cosines(direction, n), dot(n, v)[:, None]
    half = (2 + 2 * cosines(direction, v)).clamp_min(1e-6).sqrt()
    return FacetCosines((n_l + n_v) / half, half / 2, n_l, n_v)


def is_small(facets: FacetCosines, size2: Tensor, roughness: Tensor) -> Tensor:
    """(P, E): whether all of an emitter is mirrored about as its middle is; size2: (P, E), squared tangents of its
    radius."""
    slope2 = 1 / facets.n_h.square().clamp_min(1e-6) - 1
    return (size2 < SMALL * (slope2 + _alpha(roughness)[:, None].square())) & (size2 < facets.n_l.square())


def facet_width2(roughness: Tensor) -> Tensor:
    """Squared tangent of the angle within which a good part of facets turn."""
    return _alpha(roughness).square()


def small_emitter_share(facets: FacetCosines, sine2: Tensor, roughness: Tensor, f0: Tensor) -> Tensor:
    """(P, E) share of an emitter's radiance that the lobe sends on, relative to its share of uniform light.

    sine2: (P, E), as of form_factors.py; roughness, f0: (P,).
    """
    alpha2 = _alpha(roughness)[:, None].square()
    density = alpha2 / (math.pi * (facets.n_h.square() * (alpha2 - 1) + 1).square().clamp_min(1e-12))
    share = density * _unmasked(alpha2, facets.n_v, facets.n_l) / 4 * math.pi * sine2
    return share * _relative_fresnel(f0, facets.n_v[:, 0], facets.v_h, roughness) * (facets.n_l > 0)


def emitter_share(ring: Tensor, n: Tensor, v: Tensor, roughness: Tensor, f0: Tensor) -> Tensor:
    """(R,) the same of emitters seen along rings of vectors (K, 3, R); n, v: (3, R); roughness, f0: (R,)."""
    basis, alpha = local_basis(n.T), _alpha(roughness)
    ring, v = (torch.einsum("rij,...jr->...ir", basis, x) for x in (ring, v))
    v = unit(torch.stack([v[0], v[1], v[2].abs().clamp_min(LEAST_COSINE)]), 0)
    facets = _shown_facets(unit(ring, 1), v, alpha)
    facets = facets * facets[2].sign()  # of an emitter whose back is seen
    shown = (facets[2] / (2 * math.pi)).clamp(0, 1)
    half = unit(torch.stack([facets[0] * alpha, facets[1] * alpha, facets[2].clamp_min(1e-9)]), 0)  # their mean
    v_h = dot(half, v, 0).clamp_min(0)
    share = shown * _unmasked(alpha.square(), v[2], 2 * v_h * half[2] - v[2]) * v_h / half[2].clamp_min(LEAST_COSINE)
    return share * _relative_fresnel(f0, v[2], v_h[:, None], roughness)[:, 0]


def _shown_facets(ring: Tensor, v: Tensor, alpha: Tensor) -> Tensor:
    """(3, R) Lambert's vector of the facets that mirror what is above z = 0 within a ring (K, 3, R) of unit vectors.

    Its z is 2 pi times their share of the area that all facets show; across, the surface is stretched to alpha = 1.
    """
    return lambert_vector(ring, lambda rows, towards: _mirroring_facets(v[:, rows], alpha[rows], towards))


def _mirroring_facets(v: Tensor, alpha: Tensor, towards: Tensor) -> Tensor:
    """(K, 3, R) unit normals of the facets that mirror unit vectors (K, 3, R) to the viewer, stretched."""
    # Along great circles h = l + v follows none. It does if l ends on the plane across the mirrored direction, which is
    # the same where smooth surfaces show anything.
    straight = ((ROUGH - alpha) / (ROUGH - SMOOTH)).clamp(0, 1)
    mirrored = torch.stack([-v[0], -v[1], v[2]])
    on_plane = 1 / dot(towards, mirrored[None], 1)[:, None].clamp_min(0.5)
    half = towards * torch.lerp(torch.ones_like(on_plane), on_plane, straight) + v
    return unit(torch.cat([half[:, :2], half[:, 2:] * alpha], 1), 1)


def _unmasked(alpha2: Tensor, n_v: Tensor, n_l: Tensor) -> Tensor:
    """Share of facets that neither viewer nor light lose behind others, over the cosine to the viewer (Smith)."""
    n_v, n_l = n_v.abs().clamp_min(LEAST_COSINE), n_l.clamp_min(1e-4)
    return 2 * n_l / (n_l * smith_root(n_v, alpha2) + n_v * smith_root(n_l, alpha2))


def _relative_fresnel(f0: Tensor, n_v: Tensor, v_h: Tensor, roughness: Tensor) -> Tensor:
    """(P, E) reflectance of facets that light meets at cosines v_h (P, E), over that of the lobes (P,)."""
    return reflectance(f0[:, None], v_h) / lobe_albedo(f0, n_v, roughness)[:, None]


def _alpha(roughness: Tensor) -> Tensor:
    return roughness.clamp_min(LEAST_ROUGHNESS).square()
