# SPDX-License-Identifier: GPL-3.0-or-later
"""Guides of a view as tensors: the data of every pixel that the guided network is given."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from ..camera import view_rays_at
from ..fields import COLOR, DIRECTION, POINT, Channels, array
from ..geometry import contracted
from ..network.inputs import TensorGroup
from ..network.memory import like
from ..progress import part
from ..scene import ROUGHNESS, Guides, RenderScene, View, texels
from .bounce.probes import gathered, grid_of
from .bounce.radiosity import Radiosity
from .prior.light_prior import LightPrior
from .specular import blur
from .specular import reflected as reflected_ray

FEATURES = Channels(
    1,
    offset=(3, DIRECTION),    # from the bundle's position
    normal=(3, DIRECTION),
    colors=(9, COLOR),        # diffuse, glossy, transmission
    roughness=1,
    alpha=1,                  # coverage
    light=(9, COLOR),         # log10(1 + prior) of the lobes
    mirrored=(3, DIRECTION),  # the ray, mirrored
    bounced=(3, COLOR),       # log10(1 + radiosity)
    traced=(3, COLOR),        # log10(1 + traced light)
    hinted=1,                 # 1 if light was traced
    reflected=(3, COLOR),     # log10(1 + radiosity) of what is seen in mirrors
    refracted=(3, COLOR),     # and through glass
)
BAND_PIXELS = 1 << 17     # computed at once: guides of a large picture are gigabytes
OFFSET_SCALE = 8.0        # in-bundle offsets are a few hundredths of a unit
UNSEEN_DISTANCE = 2.0     # where a bundle that hits nothing is placed along its rays, network units
AROUND = 0.8              # share of the light from all around that a rough surface reflects besides its colour
UNKNOWN_ROUGHNESS = 0.5   # where no token triangle lies behind a pixel (hair, sub-pixel geometry)


@dataclass
class GuideTensors(TensorGroup):
    """V views, H x W pixels, R ray bundles; all f32, in network units and exposure.

    The three lobes of `colors` and `prior` are diffuse, glossy, transmission.
    """

    features: Tensor = array("V", len(FEATURES), "H", "W", channels=FEATURES)
    colors: Tensor = array("V", 3, 3, "H", "W", behaves={COLOR: 2})  # [lobe, rgb], premultiplied by coverage
    prior: Tensor = array("V", 3, 3, "H", "W", behaves={COLOR: 2})   # radiance of a white lobe (LightPrior)
    positions: Tensor = array("V", "R", 3, behaves=POINT)            # mean first hit of every bundle
    bounced: Tensor = array("V", 3, "H", "W", behaves={COLOR: 1})    # radiosity: radiance of a white diffuse surface
    behind: Tensor = array("V", 3, "H", "W", behaves={COLOR: 1})     # the same of its other side, where light passes
    reflected: Tensor = array("V", 3, "H", "W", behaves={COLOR: 1})  # radiance of what mirrors show, by radiosity
    refracted: Tensor = array("V", 3, "H", "W", behaves={COLOR: 1})  # and glass
    traced: Tensor = array("V", 3, "H", "W", behaves={COLOR: 1})     # radiance; 0 if nothing was traced


def guide_tensors(scene: RenderScene, view: View, guides: Guides, prior: LightPrior, radiosity: Radiosity,
                  patch: int) -> GuideTensors:
    """Tensors of one view (V = 1) on the prior's device, for ray bundles of `patch` pixels along a side.

    Scene, view, guides and prior are all normalised; H and W are multiples of `patch`.
    """
    h, w = guides.alpha.shape
    rows = _rows(w, patch)
    features = light = None
    bundles, pictures = [], []
    for begin in range(0, h, rows):
        pixels = slice(begin, begin + rows)
        with part(begin / h, min(begin + rows, h) / h):
            band = _band(scene, view, guides, prior, radiosity, pixels, patch)
        if features is None:
            features, light = like(band.features, h, 1), like(band.light, h, 1)
        features[:, pixels], light[:, pixels] = band.features, band.light
        bundles.append(band.positions)
        pictures.append(band.pictures)
    lobes = lambda x: x.view(1, 3, 3, h, w)  # noqa: E731
    return GuideTensors(features[None], lobes(features[FEATURES["colors"]]), lobes(light), torch.cat(bundles)[None],
                        *torch.cat(pictures, dim=1).permute(0, 3, 1, 2)[:, None])


@dataclass
class _Band:
    """Some rows of the picture, whole bundles."""

    features: Tensor   # (C, h, W)
    light: Tensor      # (9, h, W)
    positions: Tensor  # (R, 3)
    pictures: Tensor   # (5, h, W, 3): bounced, behind, reflected, refracted, traced


def _band(scene: RenderScene, view: View, guides: Guides, prior: LightPrior, radiosity: Radiosity, rows: slice,
          patch: int) -> _Band:
    device = prior.radiance.device
    tensor = lambda x: torch.as_tensor(np.ascontiguousarray(x), dtype=torch.float32, device=device)  # noqa: E731
    guides = Guides(**{name: array[rows] for name, array in guides.arrays().items()})
    h, w = guides.alpha.shape
    origin, rays = map(tensor, view_rays_at(view, np.arange(w) + 0.5, rows.start + np.arange(h)[:, None] + 0.5))
    position, alpha = tensor(guides.position), tensor(guides.alpha)[..., None].clamp(0, 1)
    normal = F.normalize(tensor(guides.normal), dim=-1)
    roughness = tensor(hit_roughness(scene, guides))
    probed = partial(gathered, grid=grid_of(view.longer_side))
    lit = partial(probed, lambda *probes: radiosity(*probes)[:, :3], noisy=True)
    with part(0.0, 0.2):
        arriving = probed(lambda x, n, _: prior.arriving(x, n), position, normal, alpha > 0)
    with part(0.2, 0.4):
        light = prior(*(x.reshape(h * w, -1) for x in (position, normal, -rays)), roughness.reshape(-1),
                      arriving.reshape(h * w, 6))
        light = light.reshape(h, w, 9) * (alpha > 0)
    with part(0.4, 0.7):
        bounced, around = probed(radiosity, position, normal, alpha > 0, noisy=True).split(3, dim=-1)
    with part(0.7, 0.8):
        through = tensor(guides.transmission_color).amax(-1, keepdim=True) > 0
        behind = lit(position, -normal, through)
    with part(0.8, 0.9):
        mirrored_light = _seen_light(lit, guides, "reflected", tensor)
        reflected = torch.lerp(mirrored_light, AROUND * around, blur(roughness)[..., None])
    with part(0.9, 1.0):
        refracted = _seen_light(lit, guides, "refracted", tensor)
    hinted = torch.full_like(alpha, guides.traced is not None)
    traced = torch.zeros_like(position) if guides.traced is None else tensor(guides.traced).clamp_min(0)
    colors = torch.cat([tensor(c) for c in (guides.diffuse_color, guides.glossy_color, guides.transmission_color)], -1)
    near = contracted(position)
    bundles = bundle_positions(near, alpha, rays, origin, patch)
    offset = (near - bundles.repeat_interleave(patch, 0).repeat_interleave(patch, 1)) * OFFSET_SCALE * (alpha > 0)
    mirrored = reflected_ray(rays, normal)
    features = torch.cat([offset, normal, colors, roughness[..., None], alpha, _log(light), mirrored, _log(bounced),
                          _log(traced), hinted, _log(reflected), _log(refracted)], -1)
    return _Band(features.permute(2, 0, 1), light.permute(2, 0, 1), bundles.reshape(-1, 3),
                 torch.stack([bounced, behind, reflected, refracted, traced]))


def _seen_light(lit: Callable, guides: Guides, name: str, tensor) -> Tensor:
    """(h, W, 3) radiance of the surfaces that the paths of this `name` end at."""
    parts = [getattr(guides, f"{name}_{kind}") for kind in ("position", "normal", "color")]
    if parts[0] is None:
        return tensor(np.zeros_like(guides.position))
    position, normal, color = map(tensor, parts)
    return lit(position, F.normalize(normal, dim=-1), color.amax(-1, keepdim=True) > 0) * color


def _log(radiance: Tensor) -> Tensor:
    return torch.log10(1 + radiance)


def bundle_positions(position: Tensor, alpha: Tensor, rays: Tensor, origin: Tensor, patch: int) -> Tensor:
    """(H / patch, W / patch, 3) mean first hit of each bundle; some way along its mean ray where it hits nothing.

    `position` and the result are in contracted space.
    """
    weight = (alpha > 0).float()
    pooled = F.avg_pool2d(torch.cat([position * weight, weight, rays], -1).permute(2, 0, 1)[None], patch)[0]
    hit, share, ray = pooled.permute(1, 2, 0).split([3, 1, 3], -1)
    unseen = contracted(origin + UNSEEN_DISTANCE * F.normalize(ray, dim=-1))
    return torch.where(share > 0, hit / share.clamp_min(1e-6), unseen)


def band_rows(picture: Tensor, patch: int = 1) -> int:
    """Rows of a band of (V, C, H, W) that fits into memory, whole ray bundles; all with gradients."""
    views, _, height, width = picture.shape
    return height if torch.is_grad_enabled() else _rows(views * width, patch)


def _rows(width: int, patch: int) -> int:
    return max(BAND_PIXELS // width // patch, 1) * patch


def hit_roughness(scene: RenderScene, guides: Guides) -> np.ndarray:
    """(H, W) f32 roughness of the texel that each pixel centre hits."""
    hit = guides.hit_triangle
    if not len(scene.triangles):
        return np.full(hit.shape, UNKNOWN_ROUGHNESS, np.float32)
    x, y = texels(guides.hit_barycentric)
    tile = scene.tile_index[np.maximum(hit, 0)]
    roughness = scene.tiles[tile, ROUGHNESS, y, x].astype(np.float32)
    return np.where(hit >= 0, roughness, np.float32(UNKNOWN_ROUGHNESS))
