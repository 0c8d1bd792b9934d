# SPDX-License-Identifier: GPL-3.0-or-later
"""How many rays are spent on light: all for pictures that stay, fewer for those that the next ones replace at once."""
from __future__ import annotations

from dataclasses import dataclass, replace

FEW_PIXELS = 512 * 256  # below which each probe has more rays, so that there are as many in all


@dataclass(frozen=True)
class Effort:
    rays: float = 1.0      # share of the rays of a finished picture
    probe_rays: float = 1.0  # and of those of a probe, of which there may be fewer
    most_more: float = 8.0  # times as many rays of a probe in a small picture, at most
    shadow_grid: int = 1   # pixels between points where shadows are looked for, at least
    probe_grid: int = 1    # and between those where bounced light is
    closer: int = 2        # times as close probes stand where those around say little
    smoothings: int = 2    # of light that was found by rays
    patches: float = 1.0   # share of those between which light bounces
    walls: bool = True     # whether they end at these
    network: bool = True   # whether the transformer corrects the light
    edges: bool = True     # whether pixels show the light of all surfaces that they see

    def of(self, count: int) -> int:
        """So many of `count` rays, one at least."""
        return max(round(self.rays * count), 1)

    def of_probe(self, count: int) -> int:
        """The same of a probe."""
        return max(round(self.probe_rays * count), 1)

    def of_picture(self, pixels: int) -> Effort:
        """Of a picture with so many pixels."""
        return replace(self, probe_rays=self.probe_rays * min(max(FEW_PIXELS / pixels, 1.0), self.most_more))


FULL = Effort()
QUICK = Effort(rays=1 / 3, probe_rays=2 / 3, most_more=1.0, shadow_grid=2, probe_grid=4, closer=1, smoothings=1,
               walls=False, network=False, edges=False)
DRAFT = Effort(rays=1 / 6, patches=0.5, walls=False)  # of light between surfaces, until the network is done
