# SPDX-License-Identifier: GPL-3.0-or-later
"""Radiance that media send along rays, by equal steps through their grid."""
from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from .transmittance import SIDE, Fog


class RayMarch(NamedTuple):
    """What was found along P rays in K steps."""

    radiance: Tensor  # (P, 3) at their beginnings
    begin: Tensor     # (P, 1) distance at which they enter the grid, in network units
    length: Tensor    # (P, 1) of a step
    depth: Tensor     # (P, K + 1, C) optical depth before the first step, and at the ends of all

    def transmittance(self, distance: Tensor) -> Tensor:
        """(P, N, C) from distances (P, N) to the beginnings of the rays."""
        steps = self.depth.shape[1] - 1
        step = ((distance - self.begin) / self.length.clamp_min(1e-9)).clamp(0, steps)
        low = step.long().clamp(max=steps - 1)
        before, after = (self.depth.gather(1, (low + i)[..., None].expand(-1, -1, self.depth.shape[2]))
                         for i in (0, 1))
        return (-torch.lerp(before, after, (step - low)[..., None])).exp()


def march(fog: Fog, sent_at: Callable[[Tensor, Tensor], tuple[Tensor, Tensor]], origin: Tensor, end: Tensor,
          steps: int) -> RayMarch:
    """From points (P, 3) to points (P, 3).

    sent_at: at points (P, 3) at distances (P, 1) from the origins, what is sent per unit of length (P, 3), and the
    extinction (P, C).
    """
    ray = end - origin
    enters, leaves = fog.crossed(origin, ray)
    step = (leaves - enters) * ray / steps
    length, begin = step.norm(dim=1, keepdim=True), enters * ray.norm(dim=1, keepdim=True)
    radiance, depths = torch.zeros_like(origin), [origin.new_zeros(len(origin), fog.extinction.shape[1])]
    for k in range(steps):
        sent, extinction = sent_at(origin + enters * ray + (k + 0.5) * step, begin + (k + 0.5) * length)
        absorbed = extinction * length
        mean = torch.where(absorbed > 1e-4, -torch.expm1(-absorbed) / absorbed.clamp_min(1e-4), 1 - absorbed / 2)
        radiance += (-depths[-1]).exp() * sent * length * mean
        depths.append(depths[-1] + absorbed)
    return RayMarch(radiance, begin, length, torch.stack(depths, 1))


def fire_along(fog: Fog, begin: np.ndarray, direction: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """(P, 3) radiance of fire at points (P, 3) along unit vectors (P, 3) for distances (P,), which may be infinite."""
    emission = fog.as_volume(fog.emission)

    def sent_at(x: Tensor, _) -> tuple[Tensor, Tensor]:
        return fog.interpolated(emission, x), fog.extinction[fog.cells_at(x)]

    return march(fog, sent_at, *fog.segments(begin, direction, distance), SIDE).radiance.cpu().numpy()
