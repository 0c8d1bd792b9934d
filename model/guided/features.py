# SPDX-License-Identifier: GPL-3.0-or-later
"""Inputs of the guided transformer for views: their estimated light, and what it is told of every pixel."""
from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional as F

from ..fields import COLOR, DIRECTION, POINT, RADIANCE, Channels, array, map_arrays
from ..geometry import contracted, reflected
from ..light.effort import FULL, Effort
from ..light.estimate import SceneLight, estimate_light
from ..light.hit_surfaces import HitSurfaces
from ..light.surface_light import SurfaceLight
from ..network.config import ModelConfig
from ..network.inputs import ViewInputs, view_inputs
from ..scene import Guides, View
from .exposure import key_exposure

FEATURES = Channels(
    1,
    offset=(3, DIRECTION),    # of the first hit from the position of its ray bundle
    normal=(3, DIRECTION),
    colors=(9, COLOR),        # albedo of diffuse, glossy, transmission
    roughness=1,
    alpha=1,                  # coverage
    light=(9, COLOR),         # log10(1 + direct light) of the lobes
    mirrored=(3, DIRECTION),  # the ray, mirrored
    bounced=(3, COLOR),       # log10(1 + ...) of SurfaceLight's fields, here and below
    traced=(3, COLOR),
    hinted=1,                 # 1 if light was traced
    reflected=(3, COLOR),
    refracted=(3, COLOR),
)
RADIANCE_FEATURES = {"light": "direct", "bounced": "bounced", "traced": "traced", "reflected": "reflected",
                     "refracted": "refracted"}  # by field of SurfaceLight
OFFSET_SCALE = 8.0     # offsets within a bundle are a few hundredths of a unit
MISS_DISTANCE = 2.0    # network units along its mean ray at which a bundle lies that hits nothing


@dataclass(kw_only=True)
class GuidedView(ViewInputs):
    """V views, in an exposure of their own: the log average of what each shows is the same."""

    positions: Tensor = array("V", "R", 3, behaves=POINT)  # of the R ray bundles: mean first hit, contracted
    features: Tensor = array("V", len(FEATURES), "H", "W", channels=FEATURES)
    light: SurfaceLight
    exposure: Tensor = array("V")                          # factor on network exposure


def guided_view(light: SceneLight, view: View, guides: Guides, config: ModelConfig,
                effort: Effort = FULL) -> GuidedView:
    """Inputs for one view, normalised as the scene of the light is, on the device of that."""
    estimate = estimate_light(light, view, guides, effort)
    surfaces = HitSurfaces.of(light.scene, view, guides, 0, light.direct.device)
    exposure = key_exposure(estimate.radiance().mean(1)[surfaces.coverage[None, ..., 0] > 0]).expand(1)
    exposed = with_exposure(estimate, exposure)
    position = contracted(surfaces.position)
    bundles = bundle_positions(position, surfaces, config.patch_size)
    rays = view_inputs(view).to(light.direct.device)
    return GuidedView(origin=rays.origin, directions=rays.directions, positions=bundles.reshape(1, -1, 3),
                      features=_features(exposed, surfaces, position, bundles, config.patch_size), light=exposed,
                      exposure=exposure)


def with_exposure(light: SurfaceLight, exposure: Tensor) -> SurfaceLight:
    """Light (V views) with its radiance scaled by factors (V,)."""
    return map_arrays(light, {RADIANCE: lambda x: x * exposure.view(-1, *[1] * (x.ndim - 1))})


def _features(light: SurfaceLight, surfaces: HitSurfaces, position: Tensor, bundles: Tensor, patch: int) -> Tensor:
    """(1, len(FEATURES), H, W) of exposed light."""
    offset = position - bundles.repeat_interleave(patch, 0).repeat_interleave(patch, 1)
    channels_first = lambda x: x.permute(2, 0, 1)[None]  # noqa: E731
    features = torch.empty(1, len(FEATURES), *surfaces.roughness.shape, device=position.device)
    parts = {"offset": channels_first(offset * OFFSET_SCALE * surfaces.is_covered),
             "normal": channels_first(surfaces.normal), "colors": light.albedo.flatten(1, 2),
             "roughness": light.roughness, "alpha": channels_first(surfaces.coverage),
             "mirrored": channels_first(reflected(surfaces.rays, surfaces.normal)),
             "hinted": light.is_traced.view(-1, 1, 1, 1)}
    parts |= {name: torch.log10(1 + getattr(light, field).flatten(1, -3)) for name, field in RADIANCE_FEATURES.items()}
    for name, values in parts.items():
        features[:, FEATURES[name]] = values
    return features


def bundle_positions(position: Tensor, surfaces: HitSurfaces, patch: int) -> Tensor:
    """(H / patch, W / patch, 3) mean first hit of each ray bundle; a point on its mean ray where nothing is hit.

    `position` (H, W, 3), of the first hits, and the result are in contracted space.
    """
    weight = surfaces.is_covered.float()
    pooled = F.avg_pool2d(torch.cat([position * weight, weight, surfaces.rays], -1).permute(2, 0, 1)[None], patch)[0]
    hit, share, ray = pooled.permute(1, 2, 0).split([3, 1, 3], -1)
    miss = contracted(surfaces.origin + MISS_DISTANCE * F.normalize(ray, dim=-1))
    return torch.where(share > 0, hit / share.clamp_min(1e-6), miss)
