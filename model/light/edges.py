# SPDX-License-Identifier: GPL-3.0-or-later
"""Smooth edges of added light: a pixel that sees several surfaces shows the light of each.

Light is found for the middle of each pixel. Where the pixels around see other surfaces, some rays tell how much a pixel
sees of which, and it takes their light from those around that see them in their middle (subpixel reconstruction
antialiasing, Chajdas et al. 2011).
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from ..first_hits.camera_rays import PLACES, CameraRays, Samples
from ..first_hits.from_rays import lobe_colors
from ..pictures import bands
from ..scene import Guides, RenderScene, View
from .edge_stopping import alike, nearness

AROUND = tuple((y, x) for y in (-1, 0, 1) for x in (-1, 0, 1))  # rows and columns
MIDDLE = AROUND.index((0, 0))
MARGIN = 2          # pixels around one on which it depends
ONE_SURFACE = 0.5   # likeness from which two pixels see one surface
NEAR = 2.0          # a pixel's light counts exp(-NEAR d^2) for what is d pixels from its middle
AGREED = 0.01       # of the distance, by which what a pixel shows may be off the tokens
LEAST = 1e-4        # weight of the pixel's own light, which is all there is if none around sees the surface
UNSEEN = 1e-3       # weight of what is around beside what rays found, should that have no colour at all
BLACK = 1e-6        # is added to colours, by which light is weighted
AT_ONCE = 1 << 14   # pixels
NEARNESS = np.exp(-NEAR * np.square(PLACES[:, None, ::-1] - np.array(AROUND) - 0.5).sum(-1)).astype(np.float32)  # K, 9


@dataclass
class Edges:
    """E pixels of a picture that see several surfaces, and whose light they show."""

    at: Tensor      # (E,) among the H W pixels
    around: Tensor  # (E, 9) those around, too
    share: Tensor   # (9, E, 9) f32, of the light of each of them, by lobe and colour; the sum is 1

    def mix(self, light: Tensor, lobe: int, dims_only: bool = False) -> None:
        """Mix light (3, H, W) of a lobe there, or only where that makes it dimmer."""
        flat = light.view(3, -1)
        mixed = (flat[:, self.around] * self.share[3 * lobe:3 * lobe + 3]).sum(-1)
        flat[:, self.at] = torch.minimum(mixed, flat[:, self.at]) if dims_only else mixed


def edges(scene: RenderScene, view: View, guides: Guides, device: torch.device) -> Edges:
    """Of a normalised scene; none where its tokens are not what the guides show, as when they are simplified."""
    camera, every, around, share = CameraRays(scene, view), [], [], []
    for outer, inner in bands(*guides.alpha.shape, margin=MARGIN):
        band, first = guides.rows(outer), outer.start * view.width
        picture = _Picture.of(band, device)
        beside = picture.beside_others().cpu().numpy() & (band.hit_triangle >= 0)
        colors = np.zeros((3, *beside.shape, 3), np.float32)
        colors[:, beside] = lobe_colors(scene, band.hit_triangle[beside], band.hit_barycentric[beside])
        own = np.zeros_like(beside)
        own[inner] = beside[inner]
        at = np.flatnonzero(own)
        at = at[camera.end_at(band.position.reshape(-1, 3)[at], AGREED)]
        for some in np.array_split(at, len(at) // AT_ONCE + 1):
            near, shown = picture.shown_by(some, camera.samples(first + some), colors)
            every.append(torch.from_numpy(first + some).to(device))
            around.append(first + near)
            share.append(shown)
    return Edges(torch.cat(every), torch.cat(around), torch.cat(share, 1))


def _planes(picture: np.ndarray, device: torch.device) -> Tensor:
    """(H, W, C) -> (C, H, W) f32."""
    return torch.from_numpy(np.ascontiguousarray(np.moveaxis(picture, -1, 0), np.float32)).to(device)


@dataclass
class _Picture:
    """What is seen in the middle of each pixel."""

    position: Tensor  # (3, H, W)
    normal: Tensor    # (3, H, W), unit
    covered: Tensor   # (H, W) bool
    near: Tensor      # (H, W), of `nearness`

    @classmethod
    def of(cls, guides: Guides, device: torch.device) -> _Picture:
        position, covered = _planes(guides.position, device), torch.from_numpy(guides.alpha > 0).to(device)
        return cls(position, F.normalize(_planes(guides.normal, device), dim=0), covered, nearness(position, covered))

    def beside_others(self) -> Tensor:
        """(H, W) bool: covered pixels beside others that see another surface."""
        h, w = self.covered.shape
        found = torch.zeros_like(self.covered)
        for y, x in AROUND[MIDDLE + 1:]:  # the others see the same from the other side
            here = slice(0, h - y), slice(max(-x, 0), w - max(x, 0))
            there = slice(y, h), slice(max(x, 0), w - max(-x, 0))
            away = self.position[:, *there] - self.position[:, *here]
            like = alike(away, self.normal[:, *there], self.normal[:, *here], self.near[here])
            other = (like < ONE_SURFACE) & self.covered[here] & self.covered[there]
            found[here] |= other
            found[there] |= other
        return found

    def shown_by(self, at: np.ndarray, samples: Samples, middles: np.ndarray) -> tuple[Tensor, Tensor]:
        """`around` and `share` of pixels by their number (E,), of whose surroundings these are samples.

        middles: (3, H, W, 3) colours of the lobes in the middle of pixels beside others.
        """
        device, (h, w) = self.near.device, self.near.shape
        position, normal = (_planes(each, device)[..., None] for each in (samples.position, samples.normal))
        colors, middles = (torch.from_numpy(each).to(device).permute(0, 3, 1, 2).flatten(0, 1)  # (9, E, K), (9, H, W)
                           for each in (samples.colors, middles))
        steps = torch.tensor(AROUND, device=device)
        pixel = torch.from_numpy(at).to(device)[:, None]
        y, x = pixel // w + steps[:, 0], pixel % w + steps[:, 1]
        inside = (y >= 0) & (y < h) & (x >= 0) & (x < w)
        around = y.clamp(0, h - 1) * w + x.clamp(0, w - 1)
        of = lambda picture: picture.flatten(-2)[..., around][..., None, :]  # noqa: E731  (..., E, 1, 9)
        says = alike(of(self.position) - position, of(self.normal), normal, of(self.near))
        says = says * (of(self.covered) & inside[:, None]) * torch.from_numpy(NEARNESS).to(device)
        says[..., MIDDLE] += LEAST
        shown = torch.einsum("cek,ekn->cen", colors + BLACK, says / says.sum(-1, keepdim=True))
        shown += UNSEEN * (middles.flatten(1)[:, around] * inside)
        return around, shown / shown.sum(-1, keepdim=True)
