# SPDX-License-Identifier: GPL-3.0-or-later
"""How many rays are spent on light: all for finished pictures, fewer for coarse ones that are soon replaced."""
from __future__ import annotations

import math
from dataclasses import dataclass, replace

FEW_PIXELS = 512 * 256  # below which each pixel has more rays, so that there are as many in all


@dataclass(frozen=True)
class Effort:
    rays: float = 1.0        # share of the rays of a finished picture
    probe_rays: float = 1.0  # the same for the rays of a probe
    most_more: float = 8.0   # largest factor on both in small pictures
    shadow_grid: int = 1     # least distance in pixels between probes of shadows
    probe_grid: int = 1      # and of bounced light
    closer: int = 2          # factor on the density of probes where those around are unreliable
    smoothings: int = 3      # filters of light that rays have estimated, at most
    patches: float = 1.0     # share of the patches of a finished picture
    photon_grids: int = 3    # in which light through glass is looked up, the coarsest ones, at most
    walls: bool = True       # whether patches and probes are separated by walls
    network: bool = True     # whether the transformer corrects the light
    edges: bool = True       # whether pixels at edges get the light of all their surfaces

    def of(self, count: int) -> int:
        """The share of `count` rays, at least one."""
        return max(round(self.rays * count), 1)

    def of_probe(self, count: int, most_more: float = math.inf) -> int:
        """The share of `count` rays of a probe, at least one, and at most so many times as many."""
        return max(round(min(self.probe_rays, most_more) * count), 1)

    def of_picture(self, pixels: int) -> Effort:
        """The effort for a picture of so many pixels."""
        more = min(max(FEW_PIXELS / pixels, 1.0), self.most_more)
        return replace(self, rays=self.rays * more, probe_rays=self.probe_rays * more)


FULL = Effort()
QUICK = Effort(rays=1 / 3, probe_rays=1 / 2, most_more=1.0, shadow_grid=2, probe_grid=4, closer=1, smoothings=1,
               walls=False, network=False, edges=False)
# Of light between surfaces, while pictures are coarse.
DRAFT = Effort(rays=1 / 6, patches=1 / 6, photon_grids=2, walls=False)
