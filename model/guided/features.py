# SPDX-License-Identifier: GPL-3.0-or-later
"""Inputs of the guided transformer for views: their light, and features of every pixel."""
from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from ..fields import COLOR, DIRECTION, POINT, RADIANCE, Channels, array, map_arrays
from ..first_hits.hit_materials import hit_values
from ..geometry import contracted, reflected
from ..light.direct.emitter_light import EMITTER, STRONGEST
from ..light.effort import FULL, Effort
from ..light.estimate import SceneLight, estimate_light
from ..light.hit_surfaces import HitSurfaces, tensors_on
from ..light.surface_light import SurfaceLight
from ..light.traced_noise import without_noise
from ..network.config import ModelConfig
from ..network.inputs import ViewInputs, view_inputs
from ..scene import Guides, RenderScene, View
from .exposure import display_encode, key_exposure
from .reliability import unreliable_share

SURFACE = Channels(
    1,
    offset=(3, DIRECTION),    # of the first hit from the position of its ray bundle
    normal=(3, DIRECTION),
    mirrored=(3, DIRECTION),  # the ray, mirrored
    alpha=1,                  # coverage
    noise=1,                  # of first hits and of traced light, by the number of samples
)
FEATURES = SURFACE.joined(
    roughness=1,
    colors=(9, COLOR),        # albedo of diffuse, glossy, transmission
    direct=(9, COLOR),        # log10(1 + ...) of SurfaceLight's fields, here and below
    bounced=(3, COLOR),
    reflected=(3, COLOR),
    refracted=(3, COLOR),
    behind=(3, COLOR),
    glow=(3, COLOR),
    traced=(3, COLOR),        # the picture with traced light, and with estimates alone, as on a screen
    estimated=(3, COLOR),
    is_traced=1,              # 1 if light was traced
    has_rays=1,               # 1 if estimates are by rays: shadowed, and with bounces
    emitters=STRONGEST * len(EMITTER),  # without rays: the strongest emitters, whose shadows the network has to find
)
EMITTERS = Channels(2, **EMITTER.sizes())
LOGARITHMIC = "direct", "bounced", "reflected", "refracted", "behind", "glow"
NOISY_SAMPLES = 8.0    # whose noise is 1
CLEAN_SAMPLES = 16.0   # from which on traced light that no denoiser has seen has less and less of its noise removed
SAMPLES = 1, 128       # of a pixel in training pictures, fewest and most
OFFSET_SCALE = 8.0     # offsets within a bundle are a few hundredths of a unit
MISS_DISTANCE = 2.0    # network units along its mean ray at which a bundle lies that hits nothing


@dataclass(kw_only=True)
class GuidedView(ViewInputs):
    """V views, every one in an exposure that gives its radiance the same log average."""

    positions: Tensor = array("V", "R", 3, behaves=POINT)  # of the R ray bundles: mean first hit, contracted
    surface: Tensor = array("V", len(SURFACE), "H", "W", channels=SURFACE)
    seen: Tensor = array("V", 6, "H", "W", behaves={COLOR: 1, RADIANCE: 1})  # emitters and environment, directly
    light: SurfaceLight
    exposure: Tensor = array("V")                          # factor on network exposure
    has_media: Tensor = array("V")                         # 1 if the scene has media, whose light no lobe explains
    # 1 where estimates know all light: it may bounce, lamps shine as they say, and lobes have their shape
    is_known: Tensor = array("V", 1, "H", "W")
    emitters: Tensor = array("V", STRONGEST, len(EMITTER), "H", "W", channels=EMITTERS)  # of each pixel, or 0
    unreliable: Tensor = array("V", 1, "H", "W")  # share of traced light that is lost in its noise

    def features(self, rows: slice = slice(None)) -> Tensor:
        """(V, len(FEATURES), h, W) f32 of some rows of pixels."""
        light = self.light.rows(rows)
        bounces, is_traced = light.bounces(), light.is_traced.view(-1, 1, 1, 1)
        dark = torch.zeros_like(light.roughness)
        parts = {"roughness": light.roughness, "colors": light.albedo.flatten(1, 2)}
        parts |= {name: torch.log10(1 + getattr(light, name).flatten(1, -3)) for name in LOGARITHMIC}
        parts |= {"traced": is_traced * display_encode(light.traced + bounces),
                  "estimated": display_encode(light.estimate() + bounces), "is_traced": dark + is_traced,
                  "has_rays": dark + light.has_rays.view(-1, 1, 1, 1),
                  "emitters": self.emitters[..., rows, :].flatten(1, 2)}
        return torch.cat([self.surface[..., rows, :], *parts.values()], 1)

    def complete(self, radiance: Tensor) -> Tensor:
        """(V, 3, H, W) of surfaces and media with the emitters and the environment that are seen directly."""
        return radiance + self.seen.unflatten(1, (2, 3)).sum(1)

    def rows(self, rows: slice) -> GuidedView:
        """Some rows of the pixels, with the ray bundles of all."""
        return replace(self, surface=self.surface[..., rows, :], seen=self.seen[..., rows, :],
                       is_known=self.is_known[..., rows, :], light=self.light.rows(rows),
                       emitters=self.emitters[..., rows, :], unreliable=self.unreliable[..., rows, :])


def guided_view(light: SceneLight, view: View, guides: Guides, config: ModelConfig,
                effort: Effort = FULL) -> GuidedView:
    """Inputs for one view. View and guides are in network units; the result is on the device of the scene's light."""
    device = light.direct.device
    estimate = estimate_light(light, view, guides, effort)
    surfaces = HitSurfaces.of(light.scene, view, guides, 0, device)
    is_known = _known(light.scene, guides, device)
    if guides.traced is not None and guides.is_noisy is not None:
        noisy = guides.is_noisy * (CLEAN_SAMPLES / samples_of(guides)).clip(max=1)
        estimate = _denoised(estimate, surfaces.normal, is_known * torch.as_tensor(noisy, device=device))
    seen = torch.as_tensor(np.dstack([guides.emission, guides.environment]), device=device).permute(2, 0, 1)[None]
    luminance = (estimate.radiance() + seen[:, 3:])[0].mean(0)
    shows = surfaces.is_covered[..., 0] | (seen[0, 3:].amax(0) > 0)  # or a black void would decide
    exposure = key_exposure(luminance[shows]).expand(1)
    exposed, position = with_exposure(estimate, exposure), contracted(surfaces.position)
    bundles = bundle_positions(position, surfaces, config.patch_size)
    samples = samples_of(guides)
    if light.radiosity is None:  # training without rays knew few samples
        samples = samples.clip(max=NOISY_SAMPLES)
    noise = torch.from_numpy(noise_of(samples)).to(device)
    rays = view_inputs(view).to(device)
    return GuidedView(origin=rays.origin, directions=rays.directions, positions=bundles.reshape(1, -1, 3),
                      surface=_surface(surfaces, position, bundles, noise, config.patch_size),
                      seen=seen * exposure, light=exposed, exposure=exposure,
                      has_media=torch.full_like(exposure, light.direct.fog is not None),
                      is_known=is_known, emitters=_emitters(light, surfaces),
                      unreliable=is_known * _unreliable(exposed, guides, exposure))


def _denoised(light: SurfaceLight, normal: Tensor, share: Tensor) -> SurfaceLight:
    """The light of a view with a share (1, 1, H, W) of what its traced light is without noise; normal: (H, W, 3)."""
    surface = torch.cat([normal.permute(2, 0, 1)[None], light.albedo.mean(2), light.roughness], 1)
    return replace(light, traced=light.traced.lerp(without_noise(light.traced, light.estimate(), surface), share))


def _unreliable(light: SurfaceLight, guides: Guides, exposure: Tensor) -> Tensor:
    """(1, 1, H, W) as GuidedView.unreliable, of exposed light."""
    if guides.traced is None or guides.noise is None:
        return torch.zeros_like(light.roughness)
    noise = tensors_on(exposure.device)(guides.noise).permute(2, 0, 1)[None] * exposure
    return unreliable_share(light.traced, noise, light.estimate())


def _emitters(light: SceneLight, surfaces: HitSurfaces) -> Tensor:
    """(1, STRONGEST, len(EMITTER), H, W): the strongest emitters at every first hit, where no rays find shadows."""
    height, width = surfaces.is_covered.shape[:2]
    if light.radiosity is not None:
        return surfaces.position.new_zeros(()).expand(1, STRONGEST, len(EMITTER), height, width)
    points = surfaces.position.flatten(0, 1), surfaces.normal.flatten(0, 1)
    strongest = light.direct.strongest_emitters(*points) * surfaces.is_covered.reshape(-1, 1, 1)
    return strongest.permute(1, 2, 0).unflatten(-1, (height, width))[None]


def _known(scene: RenderScene, guides: Guides, device: torch.device) -> Tensor:
    """(1, 1, H, W) as GuidedView.is_known."""
    most = scene.most_bounces
    is_known = most["diffuse"] > 0 and most["all"] > 0 and not scene.seldom("is_rough_guess").any()
    guessed = np.zeros_like(guides.alpha) if scene.guessed is None else hit_values(scene, guides, scene.guessed)
    return tensors_on(device)(is_known * (1 - guessed))[None, None]


def samples_of(guides: Guides) -> np.ndarray:
    """(H, W) f32, NOISY_SAMPLES where it is not known."""
    return np.full_like(guides.alpha, NOISY_SAMPLES) if guides.samples is None else guides.samples


def noise_of(samples: np.ndarray) -> np.ndarray:
    """Standard deviation of the mean of so many samples, relative to that of NOISY_SAMPLES; f32."""
    return np.sqrt(NOISY_SAMPLES / samples.clip(*SAMPLES)).astype(np.float32)


def with_exposure(light: SurfaceLight, exposure: Tensor) -> SurfaceLight:
    """Light (V views) with its radiance scaled by factors (V,)."""
    return map_arrays(light, {RADIANCE: lambda x: x * exposure.view(-1, *[1] * (x.ndim - 1))})


def _surface(surfaces: HitSurfaces, position: Tensor, bundles: Tensor, noise: Tensor, patch: int) -> Tensor:
    """(1, len(SURFACE), H, W)."""
    offset = position - bundles.repeat_interleave(patch, 0).repeat_interleave(patch, 1)
    return torch.cat([offset * OFFSET_SCALE * surfaces.is_covered, surfaces.normal,
                      reflected(surfaces.rays, surfaces.normal), surfaces.coverage, noise[..., None]],
                     -1).permute(2, 0, 1)[None]


def bundle_positions(position: Tensor, surfaces: HitSurfaces, patch: int) -> Tensor:
    """(H / patch, W / patch, 3) mean first hit of each ray bundle; a point on its mean ray where nothing is hit.

    `position` (H, W, 3), of the first hits, and the result are in contracted space.
    """
    weight = surfaces.is_covered.float()
    pooled = F.avg_pool2d(torch.cat([position * weight, weight, surfaces.rays], -1).permute(2, 0, 1)[None], patch)[0]
    hit, share, ray = pooled.permute(1, 2, 0).split([3, 1, 3], -1)
    miss = contracted(surfaces.origin + MISS_DISTANCE * F.normalize(ray, dim=-1))
    return torch.where(share > 0, hit / share.clamp_min(1e-6), miss)
