# SPDX-License-Identifier: GPL-3.0-or-later
"""Estimate the light at the first hits of a view, without any network: `estimate_light` is the way in.

Direct light is in closed form with visibility by rays (direct/), indirect light by radiosity and final gather
(bounce/), what mirrors and glass show by the ends of specular paths (specular/). Light that a few rays estimate is
computed at probes and interpolated.
"""
from __future__ import annotations

from dataclasses import fields

import torch
from torch import Tensor

from ..compute.inference import current_pieces, like
from ..compute.threads import Once, shared, undivided_operations
from ..light_passes import LOBES
from ..pictures import bands
from ..progress import part
from ..scene import Guides, View
from .band import Band
from .direct.direct_light import DirectLight
from .direct.footprints import footprints
from .direct.pixels import add_sheen
from .edges import find_edges
from .effort import FULL, Effort
from .hit_surfaces import HitSurfaces
from .surface_light import SurfaceLight
from .view_light import SceneLight, ViewLight

PATHS, BANDS = 0.2, 0.95  # of the work, after what paths meet and before edges
BAND_PIXELS = 1 << 17  # estimated at a time by each thread: tensors of a large picture are gigabytes
BAND_ROWS = 128        # of a band at least, for those beside it are lit too:
MARGIN = 16            # rows, from which a pixel has most of its light
ALIGNED = 8            # a band begins at a multiple of it, so that its probes are those of the picture


@undivided_operations()
def estimate_light(light: SceneLight, view: View, guides: Guides, effort: Effort = FULL,
                   with_direct: bool = True) -> SurfaceLight:
    """The light of one view (V = 1) on the device of the scene's light, in the radiance units of the scene.

    View and guides are normalised as the scene is. Without `with_direct`, where light was traced, the estimates of the
    same light are 0: the picture shows traced light instead.
    """
    if light.radiosity is None:
        return _unshadowed_light(light, view, guides)
    height, width = guides.alpha.shape
    effort, pictures = effort.of_picture(view.width * view.height), Once()
    of_view = ViewLight(light, view, effort, guides.traced is not None, with_direct)
    pixels = current_pieces().limit(max(BAND_PIXELS, BAND_ROWS * width))
    rows = list(zip(*bands(height, width, MARGIN, pixels, ALIGNED), strict=True))

    def path_images(outer: slice, inner: slice) -> list[dict[str, Tensor]]:
        return [{kind: picture[inner] for kind, picture in image.items()}
                for image in of_view.images(guides.rows(outer), outer.start)]

    def estimate(outer: slice, inner: slice) -> None:
        of_band = Band(of_view, guides, outer, images).light()
        picture = pictures.get(lambda: _with_height(of_band, height))
        band = slice(outer.start + inner.start, outer.start + inner.stop)
        for name in SurfaceLight.PICTURES:
            getattr(picture, name)[..., band, :] = getattr(of_band, name)[..., inner, :]

    device = light.direct.device
    with part(0.0, PATHS):
        images = [{kind: torch.cat([image[kind] for image in of_bands]) for kind in of_bands[0]}
                  for of_bands in zip(*shared(path_images, *rows, device=device), strict=True)]
    with part(PATHS, BANDS):
        shared(estimate, *rows, device=device)
    picture = pictures.get(None)
    if effort.edges:
        with part(BANDS, 1.0):
            _antialias(picture, light, view, guides, with_direct)
    return picture


def _unshadowed_light(light: SceneLight, view: View, guides: Guides) -> SurfaceLight:
    """Direct light in closed form, past everything that is in its way."""
    direct = light.direct
    surfaces = HitSurfaces.of(light.scene, view, guides, 0, direct.device)
    dark = torch.zeros_like(surfaces.position)
    lobes = [lobe.view_as(dark) * surfaces.is_covered for lobe in _unshadowed_lobes(direct, surfaces)]
    add_sheen(lobes[0], direct, surfaces, torch.ones_like(dark))
    if (coated := surfaces.coated) is not None:
        lobes[1] = torch.lerp(lobes[1], _unshadowed_lobes(direct, coated)[1].view_as(dark), surfaces.coat.share)
    return SurfaceLight.of_view(surfaces, False, lobes, has_rays=False)


def _unshadowed_lobes(direct: DirectLight, surfaces: HitSurfaces) -> tuple[Tensor, ...]:
    return direct.lobes(*surfaces.lobe_points, None, footprints(surfaces).flatten(0, 1))


def _antialias(picture: SurfaceLight, light: SceneLight, view: View, guides: Guides, with_direct: bool) -> None:
    """Mix the light of neighbours into pixels at edges, in place."""
    edges = find_edges(light.scene, view, guides, light.direct.device, light.direct if with_direct else None)
    for name, lobe in (("bounced", "diffuse"), ("behind", "transmission"), ("reflected", "glossy"),
                       ("refracted", "transmission")):
        edges.mix(getattr(picture, name)[0], LOBES.index(lobe))
    if with_direct:
        for lobe, radiance in enumerate(picture.direct[0]):
            edges.mix(radiance, lobe, is_direct=True)


def _with_height(estimate: SurfaceLight, height: int) -> SurfaceLight:
    """Room for the light of a picture of this height, of which there is a band."""
    return SurfaceLight(**{f.name: like(getattr(estimate, f.name), height, -2) if f.name in SurfaceLight.PICTURES
                           else getattr(estimate, f.name) for f in fields(estimate)})
