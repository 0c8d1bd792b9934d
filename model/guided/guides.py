# SPDX-License-Identifier: GPL-3.0-or-later
"""Guides of a view as tensors: what the guided preset knows about every pixel before the transformer runs."""
from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from ..camera import view_rays_at
from ..network.inputs import TensorGroup
from ..network.memory import like
from ..scene import ROUGHNESS, TILE_SIZE, Guides, RenderScene, View
from .light_prior import LightPrior

PATCH = 8                 # pixels of a ray bundle's side (ModelConfig.patch_size)
FEATURES = 29             # channels of GuideTensors.features
OFFSET, NORMAL, COLORS, LIGHT, MIRRORED = slice(0, 3), slice(3, 6), slice(6, 15), slice(17, 26), slice(26, 29)
ALPHA = 16                # the one that holds coverage
BAND_PIXELS = 1 << 17     # computed at once: guides of a large picture are gigabytes
OFFSET_SCALE = 8.0        # in-bundle offsets are a few hundredths of a unit
UNSEEN_DISTANCE = 2.0     # where a bundle that hits nothing is placed along its rays, network units
UNKNOWN_ROUGHNESS = 0.5   # where no token triangle lies behind a pixel (hair, sub-pixel geometry)


@dataclass
class GuideTensors(TensorGroup):
    """V views, H x W pixels, B = H/8 * W/8 ray bundles; all f32, in network units and exposure.

    The three lobes of `colors` and `prior` are diffuse, glossy, transmission.
    """

    features: Tensor   # (V, 29, H, W) offset 3, normal 3, colours 9, roughness 1, alpha 1, log prior 9, mirrored ray 3
    colors: Tensor     # (V, 3, 3, H, W) [lobe, rgb], premultiplied by coverage
    prior: Tensor      # (V, 3, 3, H, W) unshadowed radiance of a white lobe
    positions: Tensor  # (V, B, 3) mean first hit of every bundle

    @classmethod
    def stack(cls, views: list["GuideTensors"]) -> "GuideTensors":
        return cls(*(torch.cat([getattr(v, name) for v in views]) for name in cls.__dataclass_fields__))


def guide_tensors(scene: RenderScene, view: View, guides: Guides, prior: LightPrior, poll=None) -> GuideTensors:
    """Tensors of one view (V = 1). Scene, view, guides and prior are all normalised; H and W are multiples of 8.

    `poll()` is called while the prior is evaluated and may raise.
    """
    h, w = guides.alpha.shape
    rows = max(BAND_PIXELS // w // PATCH, 1) * PATCH
    features = light = None
    bundles = []
    for begin in range(0, h, rows):
        pixels = slice(begin, begin + rows)
        band, arriving, positions = _band(scene, view, guides, prior, pixels, poll)
        features, light = (like(part, h, 1) for part in (band, arriving)) if features is None else (features, light)
        features[:, pixels], light[:, pixels] = band, arriving
        bundles.append(positions)
    lobes = lambda x: x.view(1, 3, 3, h, w)  # noqa: E731
    return GuideTensors(features[None], lobes(features[COLORS]), lobes(light), torch.cat(bundles)[None])


def _band(scene: RenderScene, view: View, guides: Guides, prior: LightPrior, rows: slice,
          poll) -> tuple[Tensor, Tensor, Tensor]:
    """Some rows of the picture, whole bundles: features (29, h, W), light (9, h, W), positions (B, 3)."""
    device = prior.radiance.device
    tensor = lambda x: torch.as_tensor(np.ascontiguousarray(x), dtype=torch.float32, device=device)  # noqa: E731
    guides = Guides(**{field.name: getattr(guides, field.name)[rows] for field in fields(Guides)})
    h, w = guides.alpha.shape
    origin, rays = map(tensor, view_rays_at(view, np.arange(w) + 0.5, rows.start + np.arange(h)[:, None] + 0.5))
    position, alpha = tensor(guides.position), tensor(guides.alpha)[..., None].clamp(0, 1)
    normal = F.normalize(tensor(guides.normal), dim=-1)
    roughness = tensor(hit_roughness(scene, guides))
    light = prior(*(x.reshape(h * w, -1) for x in (position, normal, -rays)), roughness.reshape(-1), poll)
    light = light.reshape(h, w, 9) * (alpha > 0)
    colors = torch.cat([tensor(c) for c in (guides.diffuse_color, guides.glossy_color, guides.transmission_color)], -1)
    bundles = bundle_positions(position, alpha, rays, origin)
    offset = (position - _per_pixel(bundles)) * OFFSET_SCALE * (alpha > 0)
    mirrored = rays - 2 * (rays * normal).sum(-1, keepdim=True) * normal
    features = torch.cat([offset, normal, colors, roughness[..., None], alpha, torch.log10(1 + light), mirrored], -1)
    return features.permute(2, 0, 1), light.permute(2, 0, 1), bundles.reshape(-1, 3)


def bundle_positions(position: Tensor, alpha: Tensor, rays: Tensor, origin: Tensor) -> Tensor:
    """(H/8, W/8, 3) mean first hit of each bundle; a fixed distance along its mean ray where it hits nothing."""
    weight = (alpha > 0).float()
    pooled = F.avg_pool2d(torch.cat([position * weight, weight, rays], -1).permute(2, 0, 1)[None], PATCH)[0]
    hit, share, ray = pooled.permute(1, 2, 0).split([3, 1, 3], -1)
    unseen = origin + UNSEEN_DISTANCE * F.normalize(ray, dim=-1)
    return torch.where(share > 0, hit / share.clamp_min(1e-6), unseen)


def _per_pixel(bundles: Tensor) -> Tensor:
    return bundles.repeat_interleave(PATCH, 0).repeat_interleave(PATCH, 1)


def hit_roughness(scene: RenderScene, guides: Guides) -> np.ndarray:
    """(H, W) f32 roughness of the texel that each pixel centre hits."""
    hit = guides.hit_triangle
    if not len(scene.triangles):
        return np.full(hit.shape, UNKNOWN_ROUGHNESS, np.float32)
    texel = (guides.hit_barycentric * TILE_SIZE).astype(np.int64).clip(0, TILE_SIZE - 1)
    tile = scene.tile_index[np.maximum(hit, 0)]
    roughness = scene.tiles[tile, ROUGHNESS, texel[..., 1], texel[..., 0]].astype(np.float32)
    return np.where(hit >= 0, roughness, np.float32(UNKNOWN_ROUGHNESS))
