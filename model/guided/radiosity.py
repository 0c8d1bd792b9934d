# SPDX-License-Identifier: GPL-3.0-or-later
"""Light that has bounced between the token triangles, in closed form and without visibility (docs/architecture.md).

Classic radiosity (Goral et al. 1984) with point-to-disk form factors: what every triangle receives unshadowed it sends
on, BOUNCES times, and a surface point gathers it. Form factors over a hemisphere sum to 1 at most: more is scaled down.
"""
from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from ..geometry import area_vectors
from ..network.ordering import hilbert_order
from ..progress import report
from ..scene import BASE_COLOR, METALLIC, TRANSMISSION, RenderScene
from .light_prior import LightPrior

SOURCES = 2048     # at most: neighbouring triangles are merged to that many
BOUNCES = 2        # between triangles, before the last one at the point
CHUNK = 1024       # points at a time
METAL = 0.5        # share of a metal's reflection that spreads like a diffuse one
ABOVE = 1e-3       # network units that a point is lifted off its surface


class Radiosity:
    """Built from a normalised RenderScene and its LightPrior; the result is in the prior's radiance units."""

    def __init__(self, scene: RenderScene, prior: LightPrior):
        device = prior.radiance.device
        center, vector, albedo = (torch.as_tensor(x, dtype=torch.float32, device=device) for x in _surfaces(scene))
        self.center, self.normal, self.area, albedo = _merged(center, vector, albedo)
        ones, parts = torch.ones(len(self.center), device=device), []
        for side in (self.normal, -self.normal):
            lit = prior(self.center + ABOVE * side, side, side, ones)[:, :3]
            parts.append(albedo * lit)
        first = torch.stack(parts)  # (2, S, 3) radiance leaving the front and the back
        self.leaving = first
        for _ in range(BOUNCES):
            sides = [albedo * self(self.center + ABOVE * n, n) for n in (self.normal, -self.normal)]
            self.leaving = first + torch.stack(sides)

    def __call__(self, position: Tensor, normal: Tensor) -> Tensor:
        """Radiance leaving a white diffuse surface at points (P, 3) with unit normals (P, 3) -> (P, 3)."""
        if not len(self.center):
            return torch.zeros_like(position)
        parts = []
        for x, n in zip(position.split(CHUNK), normal.split(CHUNK), strict=True):
            report(len(parts) * CHUNK / max(len(position), 1))
            weight, front = self._form_factors(x, n)
            weight /= weight.sum(1, keepdim=True).clamp_min(1.0)
            back = weight * ~front
            parts.append((weight - back) @ self.leaving[0] + back @ self.leaving[1])
        return torch.cat(parts)

    def _form_factors(self, x: Tensor, n: Tensor) -> tuple[Tensor, Tensor]:
        """(P, S) share of the hemisphere that each triangle covers, and whether its front is seen."""
        distance2 = x.square().sum(-1, keepdim=True) + self.center.square().sum(-1) - 2 * x @ self.center.T
        distance2 = distance2.clamp_min(1e-8)
        receiving = (n @ self.center.T - (n * x).sum(-1, keepdim=True)).clamp_min(0)
        sending = x @ self.normal.T - (self.center * self.normal).sum(-1)
        return receiving * sending.abs() * self.area / (distance2 * (math.pi * distance2 + self.area)), sending > 0


def _surfaces(scene: RenderScene) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centroids, area vectors and diffuse albedo, (S, 3) each, of all triangles that are no lights."""
    rows = np.flatnonzero(~scene.is_light)
    mean = scene.tiles.astype(np.float32).mean(axis=(2, 3))[scene.tile_index[rows]]
    base, metallic, transmission = mean[:, BASE_COLOR], mean[:, METALLIC, None], mean[:, TRANSMISSION, None]
    albedo = base * ((1 - metallic) * (1 - transmission) + METAL * metallic)
    return scene.triangles[rows].mean(axis=1), area_vectors(scene.triangles[rows]), albedo


def _merged(center: Tensor, vector: Tensor, albedo: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Centre, unit normal, area and albedo of groups of triangles that follow each other along the Hilbert curve."""
    area = vector.norm(dim=-1)
    group = -(-len(center) // SOURCES)
    if group > 1:
        order = hilbert_order(center)
        key = torch.arange(len(center), device=center.device) // group
        weight = area[order, None]

        def summed(x: Tensor) -> Tensor:
            return torch.zeros(int(key[-1]) + 1, x.shape[-1], device=x.device).index_add_(0, key, x)

        total = summed(weight).clamp_min(1e-20)
        center, albedo = (summed(weight * x[order]) / total for x in (center, albedo))
        vector, area = summed(vector[order]), total[:, 0]
    normal = vector / vector.norm(dim=-1, keepdim=True).clamp_min(1e-20)
    return center, normal, area, albedo
