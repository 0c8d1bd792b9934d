# SPDX-License-Identifier: GPL-3.0-or-later
"""How often light bounces between patches, and what becomes of it: by Cycles' limits of light paths.

Sides are all fronts of patches, then all backs.
"""
from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ...scene import RenderScene
from .final_gather import Gathered

# At most: more add next to nothing. The last diffuse one is that at the point.
DIFFUSE_BOUNCES, GLOSSY_BOUNCES = 12, 2


class Bounces(NamedTuple):
    """How often light bounces."""

    diffusely: bool  # from patches to a point, whether at all
    glossily: bool
    diffuse: int     # between patches before, at most: Cycles counts the last one too
    glossy: int
    transmission: int
    all: int

    @classmethod
    def of(cls, scene: RenderScene) -> Bounces:
        most = scene.most_bounces
        diffuse, glossy, both = min(most["diffuse"], DIFFUSE_BOUNCES), most["glossy"], most["all"]
        return cls(min(diffuse, both) > 0, min(glossy, both) > 0, max(diffuse - 1, 0), min(glossy, GLOSSY_BOUNCES),
                   most["transmission"], max(both - 1, 0))

    def at_most(self, bounces: int) -> Bounces:
        """Those of light that bounces so often at most, 1 or more."""
        return self._replace(all=min(self.all, bounces - 1))


def translucent_chains(gathered: Gathered, first: Tensor, through: Tensor, most: Bounces) -> Tensor:
    """(sides, 3) of the `first` light what has gone through translucent surfaces alone, of which traced light is too.

    Cycles counts that as transmission. through: (sides, 3) albedo of what sends light to its other side.
    """
    chains = torch.zeros_like(first)
    for _ in range(min(most.transmission, most.all)):
        first = through * gathered.radiance(first).roll(len(first) // 2, 0)
        chains = chains + first
    return chains


def spread_through(translucent: Tensor | None, light: Tensor) -> Tensor:
    """Of light (sides, 3) that arrives at fronts, then backs, with a share (sides, 3) of the other side's."""
    if translucent is None:
        return light
    return torch.lerp(light, light.roll(len(light) // 2, 0), translucent)


def bounce(gathered: Gathered, light: Tensor, of_lobes: Tensor, diffuse: Tensor, glossy: Tensor,
           translucent: Tensor | None, most: Bounces) -> tuple[Tensor, Tensor, Tensor]:
    """What becomes of `light` (sides, 3) that leaves the patches, by as many bounces as are allowed: (sides, 3) each.

    Separately by glossy bounces alone, which Cycles' traced light follows from mirrors, and by all others; and the last
    diffuse bounce, which is left to those who see patches in a glossy surface or through a translucent one. of_lobes:
    (sides, 3), what of the light goes the way of PatchLobes. translucent: (sides, 3), of diffuse light the share that
    leaves the other side, which counts as transmission.
    """
    reflected = diffuse if translucent is None else diffuse * (1 - translucent)
    now = {(0, 0): light}  # by number of diffuse and of glossy bounces
    glossily, diffusely, last = (torch.zeros_like(light) for _ in range(3))
    for count in range(1, most.all + 1):
        leaving = torch.cat(list(now.values()), 1)
        arriving = gathered.with_lobes(leaving, of_lobes) if count == 1 else gathered.radiance(leaving)
        arriving, now = dict(zip(now, arriving.split(3, 1))), {}
        for (d, g), some in arriving.items():
            if d < most.diffuse + most.diffusely:
                now[d + 1, g] = reflected * some + now.get((d + 1, g), 0)
            if g < most.glossy:
                now[d, g + 1] = glossy * some + now.get((d, g + 1), 0)
            if translucent is not None and count - d - g <= most.transmission:
                now[d, g] = diffuse * translucent * some.roll(len(some) // 2, 0) + now.get((d, g), 0)
        now = {pair: now[pair] for pair in sorted(now)}
        for (d, g), bounced in list(now.items()):
            if d > most.diffuse:
                last = last + now.pop((d, g))
            elif g and not d:
                glossily = glossily + bounced
            else:
                diffusely = diffusely + bounced
        if not now:
            break
    return glossily, diffusely, last
