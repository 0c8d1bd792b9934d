# SPDX-License-Identifier: GPL-3.0-or-later
"""The light of a scene, and what all rows of a view need of it."""
from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

from torch import Tensor

from ..scene import Guides, RenderScene, View
from .bounce.pixels import GlossyPixels, glossy_bounces, outgoing_radiance
from .bounce.radiosity import Radiosity
from .direct.direct_light import DirectLight
from .direct.footprints import roughness_within
from .effort import Effort
from .hit_surfaces import HitSurfaces
from .probes import ComputeLight, Probes, probe_grid
from .specular.pixels import path_end_light, reflected_image, refracted_image

GLOSS_RAYS = 0.25  # share of the rays of a glossy lobe, of what mirrors and glass show


@dataclass
class SceneLight:
    """The light of a normalised scene, independent of views."""

    scene: RenderScene
    direct: DirectLight
    radiosity: Radiosity | None  # None: no rays; only direct light is estimated, without shadows


@dataclass
class ViewLight:
    """The same for a view, with the effort of its picture."""

    light: SceneLight
    view: View
    effort: Effort
    is_traced: bool
    with_direct: bool

    def surfaces(self, guides: Guides, first_row: int) -> HitSurfaces:
        return HitSurfaces.of(self.light.scene, self.view, guides, first_row, self.light.direct.device)

    def make_probes(self, *picture: Tensor, **options) -> Probes:
        grid = max(probe_grid(self.view.longer_side), self.effort.probe_grid)
        return Probes(*picture, grid=grid, finest=max(grid // self.effort.closer, 1), **options)

    def outgoing(self, group: int | None = None) -> ComputeLight:
        direct = self.light.direct.reaching(group) if self.with_direct else None
        return partial(outgoing_radiance, self.light.radiosity, direct, self.effort)

    def glossy(self, probes: Probes, surfaces: HitSurfaces, effort: Effort) -> GlossyPixels:
        return glossy_bounces(self.light.radiosity, probes, surfaces, effort, self.is_traced, self.with_direct)

    def _seen_gloss(self, seen: HitSurfaces) -> GlossyPixels:
        """The gloss of what mirrors and glass show."""
        probes = self.make_probes(seen.position, seen.normal, seen.is_covered)
        return self.glossy(probes, seen, replace(self.effort, probe_rays=GLOSS_RAYS * self.effort.probe_rays))

    def images(self, guides: Guides, first_row: int) -> list[dict[str, Tensor]]:
        """What mirrors, glass and clear coats, if the scene has any, of some rows would show if they were smooth.

        Where there are no coats, theirs is that of mirrors.
        """
        surfaces, direct, gather = self.surfaces(guides, first_row), self.light.direct, self._seen_gloss
        ends = partial(path_end_light, self.make_probes, self.outgoing, direct.device)
        reflected = ends("reflected", guides)
        mirrored, *coated = (reflected_image(guides, as_wide_as_pixels(mirrors), direct, gather, reflected)
                             for mirrors in (surfaces, surfaces.coated) if mirrors is not None)
        refracted = refracted_image(guides, surfaces, direct, gather, ends, self.with_direct)
        return [mirrored, refracted, *([] if self.light.scene.coat is None else coated or [mirrored])]


def as_wide_as_pixels(surfaces: HitSurfaces) -> HitSurfaces:
    """Surfaces whose lobes are as wide as all that pixels mirror."""
    return replace(surfaces, roughness=roughness_within(surfaces))
