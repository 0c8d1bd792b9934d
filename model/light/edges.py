# SPDX-License-Identifier: GPL-3.0-or-later
"""Antialias estimated light: a pixel that sees several surfaces shows the light of each.

Light is estimated in the middle of each pixel. Where neighbours see other surfaces, a few rays measure how much of each
surface the pixel covers, and its light comes from the neighbours that see these surfaces in their middle (subpixel
reconstruction antialiasing, Chajdas et al. 2011).
"""
from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from ..compute.threads import shared
from ..first_hits.camera_rays import SAMPLE_POINTS, CameraRays, Samples
from ..first_hits.from_rays import lobe_colors
from ..geometry import corner_weights, interpolated
from ..pictures import bands
from ..scene import Guides, RenderScene, View
from .direct.direct_light import DirectLight
from .direct.edge_samples import UnshadowedLight
from .edge_stopping import edge_weights, plane_tolerance
from .hit_surfaces import HitSurfaces
from .vectors import dot, length, unit

NEIGHBOURS = tuple((y, x) for y in (-1, 0, 1) for x in (-1, 0, 1))  # rows and columns
MIDDLE = NEIGHBOURS.index((0, 0))
MARGIN = 3          # pixels around one that it depends on
ONE_SURFACE = 0.5   # edge weight from which on two pixels see one surface,
KINK = 0.15         # unless normals turn by so much more between them than beside them
FALLOFF = 2.0       # a neighbour's light counts exp(-FALLOFF d^2) for a sample d pixels from its middle
SAME_NORMAL = 0.99  # cosine between the mean normals of guides and samples, below which materials or tokens bend one
AGREEMENT = 0.01    # of the distance: how far a first hit may be off the tokens
LEAST = 1e-4        # weight of the pixel's own light, the only one if no neighbour sees the surface
UNSEEN = 1e-3       # weight of the neighbours' colours beside those of the samples, should these be black
BLACK = 1e-6        # added to colours, by which light is weighted
BAND_PIXELS = 1 << 16  # of each thread
CHUNK = 1 << 14     # pixels at a time
FALLOFFS = np.exp(-FALLOFF * np.square(  # (K, 9)
    SAMPLE_POINTS[:, None, ::-1] - np.array(NEIGHBOURS) - 0.5).sum(-1)).astype(np.float32)


@dataclass
class Edges:
    """E pixels of a picture that see several surfaces, and the neighbours whose light they show."""

    pixel: Tensor       # (E,) i64, number among the H W pixels
    neighbours: Tensor  # (E, 9) i64, likewise
    share: Tensor       # (9, E, 9) f32, [3 lobe + rgb, pixel, neighbour], of the neighbours' light; sum 1
    direct: Tensor      # (9, E, 9) f32, of their direct light, times how much more of that reaches samples

    def mix(self, light: Tensor, lobe: int, is_direct: bool = False) -> None:
        """Mix the light (3, H, W) of a lobe in place."""
        flat, share = light.view(3, -1), self.direct if is_direct else self.share
        flat[:, self.pixel] = (flat[:, self.neighbours] * share[3 * lobe:3 * lobe + 3]).sum(-1)


def find_edges(scene: RenderScene, view: View, guides: Guides, device: torch.device,
               direct: DirectLight | None = None) -> Edges:
    """Edges in a view of a normalised scene; none where first hits are off its tokens, as when these are simplified.

    direct: the scene's light, of which samples get their own.
    """
    camera, (height, width) = CameraRays(scene, view), guides.alpha.shape
    found = shared(partial(_edges_of_band, scene, view, guides, device, direct, camera),
                   *zip(*bands(height, width, MARGIN, BAND_PIXELS), strict=True), device=device)
    pixel, neighbours, share, of_direct = zip(*(of_chunk for of_band in found for of_chunk in of_band), strict=True)
    share = torch.cat(share, 1)
    return Edges(torch.cat(pixel), torch.cat(neighbours), share, share if direct is None else torch.cat(of_direct, 1))


def _edges_of_band(scene: RenderScene, view: View, guides: Guides, device: torch.device, direct: DirectLight | None,
                   camera: CameraRays, outer: slice, inner: slice) -> list[tuple[Tensor, ...]]:
    """What Edges holds, in chunks, of the rows `inner` of the rows `outer` of a picture."""
    band, first = guides.rows(outer), outer.start * view.width
    picture = _Picture.of(scene, band, device)
    is_edge = picture.edges().cpu().numpy() & (band.hit_triangle >= 0)
    albedo = np.zeros((3, *is_edge.shape, 3), np.float32)
    albedo[:, is_edge] = lobe_colors(scene, band.hit_triangle[is_edge], band.hit_barycentric[is_edge])
    is_own = np.zeros_like(is_edge)
    is_own[inner] = is_edge[inner]
    own = np.flatnonzero(is_own)
    own = own[camera.hits_lie_at(band.position.reshape(-1, 3)[own], AGREEMENT)]
    light = None if direct is None or not len(own) or scene.group is not None else UnshadowedLight(
        direct, HitSurfaces.of(scene, view, band, outer.start, device), guides.traced is None)
    chunks = []
    for rows, samples in camera.sample_batches(first + own, CHUNK):
        pixel = torch.from_numpy(own[rows]).to(device)
        around, share, of_direct = picture.shares(pixel, samples, albedo, light)
        chunks.append((first + pixel, first + around, share, of_direct))
    return chunks


def _to_planes(picture: np.ndarray, device: torch.device) -> Tensor:
    """(H, W, C) -> (C, H, W) f32."""
    return torch.from_numpy(np.ascontiguousarray(np.moveaxis(picture, -1, 0), np.float32)).to(device)


def _kink(normal: Tensor, y: int, x: int) -> Tensor:
    """(H, W) how much farther normals (3, H, W) turn to the pixel y below and x to the right than on either side of it.

    So round surfaces have none, however strongly they are bent.
    """
    there = partial(torch.roll, dims=(-2, -1))
    step = length(there(normal, (-y, -x)) - normal, 0)
    return step - torch.maximum(there(step, (y, x)), there(step, (-y, -x)))


@dataclass
class _Picture:
    """The first hit in the middle of each pixel."""

    position: Tensor   # (3, H, W)
    normal: Tensor     # (3, H, W), unit
    smooth: Tensor     # (3, H, W), likewise, without the bumps of materials
    covered: Tensor    # (H, W) bool
    tolerance: Tensor  # (H, W), as of `edge_weights`

    @classmethod
    def of(cls, scene: RenderScene, guides: Guides, device: torch.device) -> _Picture:
        position, covered = _to_planes(guides.position, device), torch.from_numpy(guides.alpha > 0).to(device)
        hit, smooth = guides.hit_triangle >= 0, np.zeros_like(guides.normal)
        weights = corner_weights(guides.hit_barycentric[hit])
        smooth[hit] = interpolated(weights, scene.normals[guides.hit_triangle[hit]])
        normal, smooth = (unit(_to_planes(normals, device), 0) for normals in (guides.normal, smooth))
        return cls(position, normal, smooth, covered, plane_tolerance(position, covered))

    def edges(self) -> Tensor:
        """(H, W) bool: covered pixels with a covered neighbour that sees another surface."""
        h, w = self.covered.shape
        is_edge = torch.zeros_like(self.covered)
        for y, x in NEIGHBOURS[MIDDLE + 1:]:  # for the others the roles are swapped
            here = slice(0, h - y), slice(max(-x, 0), w - max(x, 0))
            there = slice(y, h), slice(max(x, 0), w - max(-x, 0))
            offset = self.position[:, *there] - self.position[:, *here]
            weight = torch.maximum(*(edge_weights(offset, normal[:, *there], normal[:, *here], self.tolerance[here])
                                     for normal in (self.normal, self.smooth)))  # bumps are no edges
            differs = (weight < ONE_SURFACE) | (_kink(self.smooth, y, x)[here] > KINK)
            differs &= self.covered[here] & self.covered[there]
            is_edge[here] |= differs
            is_edge[there] |= differs
        return is_edge

    def shares(self, pixel: Tensor, samples: Samples, albedo: np.ndarray,
               light: UnshadowedLight | None) -> tuple[Tensor, Tensor, Tensor]:
        """`neighbours`, `share` and `direct` as Edges has them of pixels by number (E,), from samples of these.

        albedo: (3, H, W, 3) of the lobes in the middle of edge pixels.
        """
        device = pixel.device
        position, normal = (_to_planes(x, device) for x in (samples.position, samples.normal))  # (3, E, K)
        sampled, albedo = (torch.from_numpy(x).to(device).permute(0, 3, 1, 2).flatten(0, 1)  # (9, E, K), (9, H, W)
                           for x in (samples.colors, albedo))
        neighbours, is_inside = self._neighbours(pixel)
        weight = self._weights(position, normal, neighbours, is_inside)
        sampled, unseen = sampled + BLACK, UNSEEN * (albedo.flatten(1)[:, neighbours] * is_inside)
        share = direct = torch.einsum("cek,ekn->cen", sampled, weight) + unseen
        total = share.sum(-1, keepdim=True)
        if light is not None:
            gain = light.gain(position, normal, neighbours, weight)
            gain = torch.where(self._is_unbent(pixel, normal)[:, None], gain, 1.0)
            gain = F.pad(gain, (0, 0, 0, 0, 0, 3), value=1.0)  # of transmission
            direct = torch.einsum("cek,ekn->cen", sampled * gain, weight) + unseen
        return neighbours, share / total, direct / total

    def _neighbours(self, pixel: Tensor) -> tuple[Tensor, Tensor]:
        """Numbers (E, 9) of NEIGHBOURS of pixels (E,), and bool: beyond the sides they are those of other pixels."""
        (h, w), steps = self.tolerance.shape, torch.tensor(NEIGHBOURS, device=pixel.device)
        y, x = pixel[:, None] // w + steps[:, 0], pixel[:, None] % w + steps[:, 1]
        return y.clamp(0, h - 1) * w + x.clamp(0, w - 1), (y >= 0) & (y < h) & (x >= 0) & (x < w)

    def _weights(self, position: Tensor, normal: Tensor, neighbours: Tensor, is_inside: Tensor) -> Tensor:
        """(E, K, 9) how much the light of `neighbours` counts for samples at (3, E, K): they see the same surface, near
        by in the picture. The sum is 1."""
        at = lambda picture: picture.flatten(-2)[..., neighbours][..., None, :]  # noqa: E731  (..., E, 1, 9)
        weight = edge_weights(at(self.position) - position[..., None], at(self.normal), normal[..., None],
                              at(self.tolerance))
        weight = weight * (at(self.covered) & is_inside[:, None]) * torch.from_numpy(FALLOFFS).to(weight.device)
        weight[..., MIDDLE] += LEAST
        weight /= weight.sum(-1, keepdim=True)
        return weight

    def _is_unbent(self, pixel: Tensor, normal: Tensor) -> Tensor:
        """(E,) bool: whether the normals of samples (3, E, K) are on average those that pixels (E,) have."""
        return dot(unit(normal.mean(-1), 0), self.normal.flatten(1)[:, pixel], 0) > SAME_NORMAL
