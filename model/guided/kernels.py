# SPDX-License-Identifier: GPL-3.0-or-later
"""Kernels for finished pictures: each pixel becomes a weighted mean of its neighbourhood.

With a few samples the coverage of a pixel is noisy, and so are traced light and light that a few rays estimate. The
neighbourhood as a whole is less noisy (kernel prediction, Bako et al. 2017; docs/architecture.md 4.2).
"""
from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F

from ..camera import extend_sides
from ..compute.inference import current_pieces
from ..compute.threads import shared
from ..fields import COLOR, DIRECTION, Channels
from ..light_passes import Lobes
from ..pictures import bands
from ..scene import Guides
from .exposure import display_encode, key_exposure
from .features import SURFACE, GuidedView, noise_of, samples_of
from .pixel_decoder import PixelDecoder

LATENT = 8                         # channels by which the pixel decoder has a say
INPUTS = Channels(1, image=(3, COLOR), emission=(3, COLOR), traced=(3, COLOR), colors=(9, COLOR), normal=(3, DIRECTION),
                alpha=1, noise=1, latent=LATENT)
RADIUS = 2                         # pixels, of a kernel
WEIGHTS = (2 * RADIUS + 1) ** 2    # row by row
CENTER = WEIGHTS // 2
BAND_PIXELS = 1 << 17              # filtered at a time by each thread
CENTER_LOGIT = 20.0                        # of the center, that leaves no weight for the others
BRIGHT = 0.05                       # emission of an emitter's pixel, in the exposure of the picture
FEW = 4                             # samples from which on kernels do less
BY_RAYS = 16                        # as many estimates by rays count as: their noise is that of our rays
LEAST_WEIGHT = 2e-3                       # smaller weights become 0: a neighbour may be a thousand times brighter


class KernelPredictor(PixelDecoder):
    """Features of a picture (V, len(INPUTS), H, W) -> a kernel for every pixel (V, WEIGHTS, H, W) f32, of sum 1."""

    def __init__(self, width: int):
        super().__init__(len(INPUTS), width, WEIGHTS)
        self.reset()

    def reset(self, logit: float = CENTER_LOGIT) -> None:
        """Forget all training: kernels leave pixels as they are. With a smaller logit they learn more readily."""
        nn.init.zeros_(self.leave.weight)
        nn.init.zeros_(self.leave.bias)
        nn.init.constant_(self.leave.bias[CENTER], logit)

    def forward(self, inputs: Tensor) -> Tensor:
        return super().forward(inputs).softmax(1)


def apply_kernels(picture: Tensor, kernels: Tensor, samples: Tensor | int = FEW) -> Tensor:
    """Filter pictures (V, C, H, W) by kernels (V, WEIGHTS, H, W); the outermost pixels are repeated beyond the sides.

    samples: of all pixels, or of each (V, 1, H, W); the more there are, the weaker the filter. Scenes of training have
    hardly any fine textures, and what is clean is better left alone elsewhere.
    """
    many = (samples if isinstance(samples, Tensor) else torch.tensor(float(samples))).clamp_min(FEW)
    kernels = (kernels - LEAST_WEIGHT).clamp_min(0) * (FEW / many) ** (1 / 3)
    h, w = picture.shape[2:]
    padded = F.pad(picture, (RADIUS,) * 4, mode="replicate")
    side = 2 * RADIUS + 1
    change = torch.zeros_like(picture)  # from differences, so that uniform areas stay exactly as they are
    for i in range(WEIGHTS):
        y, x = divmod(i, side)
        if i != CENTER:
            change.addcmul_(kernels[:, i, None], padded[..., y:y + h, x:x + w] - picture)
    return picture + change


def kernel_inputs(radiance: Tensor, seen: Tensor, traced: Tensor, surface: Tensor, noise: Tensor,
                  latent: Tensor | None = None) -> tuple[Tensor, Tensor]:
    """Features (V, len(INPUTS), H, W) of pictures, and (V, 1, H, W) bool, whether a kernel may change a pixel.

    radiance, traced: (V, 3, H, W) of surfaces and media, and what of it is traced light; seen: (V, 6, H, W) directly
    seen emitters and environment; all in the exposure of the whole picture. surface: (V, 13, H, W) albedos of three
    lobes, normal, alpha. noise: (V, 1, H, W) as of `noise_of`. latent: (V, LATENT, H, W).
    """
    emission, environment = seen.split(3, 1)
    light = display_encode(torch.cat([radiance + emission + environment, emission, traced], 1))
    if latent is None:
        latent = noise.new_zeros(len(noise), LATENT, *noise.shape[2:])
    return torch.cat([light, surface, noise, latent], 1), ~near_emitters(emission)


def near_emitters(emission: Tensor) -> Tensor:
    """(V, 1, H, W) bool: pixels whose kernel reaches an emitter of (V, 3, H, W), whose light it would spread."""
    bright = (emission.amax(1, keepdim=True) > BRIGHT).float()
    return F.max_pool2d(bright, 2 * RADIUS + 1, stride=1, padding=RADIUS) > 0


def antialiased_views(predictor: KernelPredictor, radiance: Tensor, view: GuidedView, latent: Tensor) -> Tensor:
    """Filter the pictures (V, 3, H, W) of views in their exposure, of which `radiance` is what `kernel_inputs` takes.

    As those of few samples, so that kernels learn to do all that they can. Emitters and environment are added before.
    """
    exposure = key_exposure((radiance.detach() + view.seen[:, 3:]).mean(1).flatten(1)).view(-1, 1, 1, 1)
    normal, alpha, noise = (view.surface[:, SURFACE[name]] for name in ("normal", "alpha", "noise"))
    surface = torch.cat([view.light.albedo.flatten(1, 2), normal * alpha, alpha], 1)
    inputs, may_change = kernel_inputs(radiance * exposure, view.seen * exposure, view.light.traced * exposure, surface,
                                       noise, latent)
    return apply_kernels(view.complete(radiance), predictor(inputs) * may_change)


def antialiased(predictor: KernelPredictor, pictures: dict[str, np.ndarray], lobes: Lobes, guides: Guides,
                wraps: bool = False) -> dict[str, np.ndarray]:
    """Filter all `pictures` (H, W, C) f32 by the kernels of one, of which there are `lobes` and `guides`.

    wraps: whether left and right side are neighbours.
    """
    reach = RADIUS + predictor.reach
    if wraps:
        wide = lambda picture: extend_sides(picture, reach, reach, wraps)  # noqa: E731
        widened = antialiased(
            predictor, {key: wide(picture) for key, picture in pictures.items()},
            Lobes(wide(lobes.radiance), latent=None if lobes.latent is None else wide(lobes.latent)),
            Guides(**{key: wide(guide) for key, guide in guides.arrays().items()}))
        return {key: picture[:, reach:-reach] for key, picture in widened.items()}
    device, (height, width) = predictor.enter.weight.device, guides.alpha.shape
    exposure = float(key_exposure(torch.from_numpy((lobes.radiance + guides.environment).mean(-1).ravel())))

    def filtered(outer: slice, inner: slice) -> np.ndarray:
        samples = samples_of(guides.rows(outer))
        inputs, may_change = _inputs(lobes.rows(outer), guides.rows(outer), np.float32(exposure), samples)
        kernels = predictor(inputs.to(device)) * may_change.to(device)
        joined = to_tensor(np.dstack([picture[outer] for picture in pictures.values()])).to(device)
        counts = BY_RAYS if guides.traced is None else to_tensor(samples[..., None]).to(device)
        return apply_kernels(joined, kernels, counts)[0, :, inner].permute(1, 2, 0).cpu().numpy()

    pixels = current_pieces().limit(BAND_PIXELS)
    parts = shared(filtered, *zip(*bands(height, width, reach, pixels), strict=True), device=device)
    ends = np.cumsum([picture.shape[-1] for picture in pictures.values()])
    return dict(zip(pictures, np.split(np.concatenate(parts), ends[:-1], axis=-1), strict=True))


def _inputs(lobes: Lobes, guides: Guides, exposure: np.float32, samples: np.ndarray) -> tuple[Tensor, Tensor]:
    """`kernel_inputs` of some rows."""
    traced = np.zeros_like(lobes.radiance) if guides.traced is None else guides.traced
    surface = np.dstack([guides.diffuse_color, guides.glossy_albedo, guides.transmission_color,
                         guides.normal * guides.alpha[..., None], guides.alpha])
    return kernel_inputs(
        to_tensor(lobes.radiance * exposure), to_tensor(np.dstack([guides.emission, guides.environment]) * exposure),
        to_tensor(traced * exposure), to_tensor(surface), to_tensor(noise_of(samples)[..., None]),
        None if lobes.latent is None else to_tensor(lobes.latent))


def to_tensor(picture: np.ndarray) -> Tensor:
    """(H, W, C) -> (1, C, H, W) f32."""
    return torch.from_numpy(np.ascontiguousarray(picture, np.float32)).permute(2, 0, 1)[None]
