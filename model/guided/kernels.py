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
from ..fields import COLOR, DIRECTION, Channels
from ..network.layers import Float32Conv2d
from ..pictures import BAND_PIXELS, bands
from ..scene import Guides
from .exposure import display_encode, key_exposure

INPUTS = Channels(1, image=(3, COLOR), emission=(3, COLOR), traced=(3, COLOR), colors=(9, COLOR), normal=(3, DIRECTION),
                alpha=1, noise=1)
RADIUS = 2                         # pixels, of a kernel
WEIGHTS = (2 * RADIUS + 1) ** 2    # row by row
CENTER = WEIGHTS // 2
DILATIONS = (1, 2, 4)
REACH = RADIUS + 1 + sum(DILATIONS)  # pixels around one that it depends on
CENTER_LOGIT = 20.0                        # of the center, that leaves no weight for the others
SAMPLES = 8, 128                   # of a pixel in training pictures, fewest and most
BRIGHT = 0.05                       # emission of an emitter's pixel, in the exposure of the picture
LEAST_WEIGHT = 2e-3                       # smaller weights become 0: a neighbour may be a thousand times brighter


class KernelPredictor(nn.Module):
    """Features of a picture (V, len(INPUTS), H, W) -> a kernel for every pixel (V, WEIGHTS, H, W) f32, of sum 1."""

    def __init__(self, width: int):
        super().__init__()
        self.enter = nn.Conv2d(len(INPUTS), width, 3, padding=1)
        self.look = nn.ModuleList(nn.Conv2d(width, width, 3, padding=d, dilation=d) for d in DILATIONS)
        self.leave = Float32Conv2d(width, WEIGHTS, 1)
        self.reset()

    def reset(self, logit: float = CENTER_LOGIT) -> None:
        """Forget all training: kernels leave pixels as they are. With a smaller logit they learn more readily."""
        nn.init.zeros_(self.leave.weight)
        nn.init.zeros_(self.leave.bias)
        nn.init.constant_(self.leave.bias[CENTER], logit)

    def forward(self, inputs: Tensor) -> Tensor:
        x = F.silu(self.enter(inputs.to(self.enter.weight.dtype)))
        for look in self.look:
            x = x + F.silu(look(x))
        return self.leave(x).softmax(1)


def apply_kernels(picture: Tensor, kernels: Tensor, samples: Tensor | int = 0) -> Tensor:
    """Filter pictures (V, C, H, W) by kernels (V, WEIGHTS, H, W); the outermost pixels are repeated beyond the sides.

    samples: of all pixels, or of each (V, 1, H, W); the more there are than in training, the weaker the filter.
    """
    trained = SAMPLES[1]
    most = samples.clamp_min(trained) if isinstance(samples, Tensor) else max(samples, trained)
    kernels = (kernels - LEAST_WEIGHT).clamp_min(0) * (trained / most)
    h, w = picture.shape[2:]
    padded = F.pad(picture, (RADIUS,) * 4, mode="replicate")
    side = 2 * RADIUS + 1
    change = torch.zeros_like(picture)  # from differences, so that uniform areas stay exactly as they are
    for i in range(WEIGHTS):
        y, x = divmod(i, side)
        if i != CENTER:
            change.addcmul_(kernels[:, i, None], padded[..., y:y + h, x:x + w] - picture)
    return picture + change


def picture_exposure(radiance: np.ndarray, guides: Guides) -> float:
    """Exposure of a whole picture, as of `kernel_inputs`, by everything but its emitters."""
    return float(key_exposure(torch.from_numpy((radiance + guides.environment).mean(-1).ravel())))


def kernel_inputs(radiance: np.ndarray, guides: Guides, exposure: float, samples: np.ndarray | int) -> Tensor:
    """(1, len(INPUTS), H, W) features of a picture (H, W, 3), world radiance without directly seen emitters and world.

    samples: of all pixels, or of each (H, W). Without traced light the channels of `traced` are 0.
    """
    traced = np.zeros_like(radiance) if guides.traced is None else guides.traced
    complete = radiance + guides.emission + guides.environment
    light = display_encode(to_tensor(np.dstack([complete, guides.emission, traced]) * np.float32(exposure)))
    surface = to_tensor(np.dstack([guides.diffuse_color, guides.glossy_color, guides.transmission_color,
                                guides.normal * guides.alpha[..., None], guides.alpha]))
    noise = to_tensor((np.zeros_like(guides.alpha) + (SAMPLES[0] / np.clip(samples, *SAMPLES)) ** 0.5)[..., None])
    return torch.cat([light, surface, noise], 1)


def near_emitters(emission: np.ndarray) -> Tensor:
    """(1, 1, H, W) bool: pixels whose kernel reaches an emitter of (H, W, 3), whose light it would spread."""
    bright = (to_tensor(emission).amax(1, keepdim=True) > BRIGHT).float()
    return F.max_pool2d(bright, 2 * RADIUS + 1, stride=1, padding=RADIUS) > 0


def antialiased(predictor: KernelPredictor, pictures: dict[str, np.ndarray], radiance: np.ndarray, guides: Guides,
                samples: np.ndarray | int, wraps: bool = False) -> dict[str, np.ndarray]:
    """Filter all `pictures` (H, W, C) f32 by the kernels of one, whose `radiance` and `guides` `kernel_inputs` takes.

    samples: of all pixels, or of each (H, W), in the first hits and in the traced light. wraps: whether left and right
    side are neighbours.
    """
    samples = np.zeros_like(guides.alpha) + samples
    if wraps:
        wide = lambda picture: extend_sides(picture, REACH, REACH, wraps)  # noqa: E731
        filtered = antialiased(predictor, {key: wide(picture) for key, picture in pictures.items()}, wide(radiance),
                           Guides(**{key: wide(guide) for key, guide in guides.arrays().items()}),
                           wide(samples))
        return {key: picture[:, REACH:-REACH] for key, picture in filtered.items()}
    device, exposure, filtered = predictor.enter.weight.device, picture_exposure(radiance, guides), []
    for outer, inner in bands(*guides.alpha.shape, margin=REACH, pixels=current_pieces().limit(BAND_PIXELS)):
        kernels = predictor(kernel_inputs(radiance[outer], guides.rows(outer), exposure, samples[outer]).to(device))
        kernels = kernels * ~near_emitters(guides.emission[outer] * np.float32(exposure)).to(device)
        joined = to_tensor(np.dstack([picture[outer] for picture in pictures.values()])).to(device)
        counts = to_tensor(samples[outer][..., None]).to(device)
        filtered.append(apply_kernels(joined, kernels, counts)[0, :, inner].permute(1, 2, 0).cpu().numpy())
    ends = np.cumsum([picture.shape[-1] for picture in pictures.values()])
    return dict(zip(pictures, np.split(np.concatenate(filtered), ends[:-1], axis=-1), strict=True))


def to_tensor(picture: np.ndarray) -> Tensor:
    """(H, W, C) -> (1, C, H, W) f32."""
    return torch.from_numpy(np.ascontiguousarray(picture, np.float32)).permute(2, 0, 1)[None]
