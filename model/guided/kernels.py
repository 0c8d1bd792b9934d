# SPDX-License-Identifier: GPL-3.0-or-later
"""Smooth noisy edges: each pixel of the finished picture becomes a weighted mean of those around it.

With a few samples the coverage of a pixel is noisy, in traced light and in added light, and so is light that a few
rays have estimated. The pixels around together show it better (kernel prediction, Bako et al. 2017;
docs/architecture.md 4.2).
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
from .exposure import key_exposure, shown

SEEN = Channels(1, image=(3, COLOR), emission=(3, COLOR), traced=(3, COLOR), colors=(9, COLOR), normal=(3, DIRECTION),
                alpha=1, noise=1)
RADIUS = 2                         # pixels, of a kernel
WEIGHTS = (2 * RADIUS + 1) ** 2    # row by row
CENTRE = WEIGHTS // 2
DILATIONS = (1, 2, 4)
REACH = RADIUS + 1 + sum(DILATIONS)  # pixels around one that have a say in it
SURE = 20.0                        # offset of the centre's logit that leaves nothing for the others
SAMPLES = 8, 128                   # of a pixel in the pictures of the training, from and to
GLOWS = 0.05                       # emission from which on it counts, in the exposure of the picture
LEAST = 2e-3                       # a weight below is none: what is a thousand times brighter would shine through


class KernelPredictor(nn.Module):
    """What is seen of a picture (V, len(SEEN), H, W) -> a kernel for every pixel (V, WEIGHTS, H, W) f32, of sum 1."""

    def __init__(self, width: int):
        super().__init__()
        self.enter = nn.Conv2d(len(SEEN), width, 3, padding=1)
        self.look = nn.ModuleList(nn.Conv2d(width, width, 3, padding=d, dilation=d) for d in DILATIONS)
        self.leave = Float32Conv2d(width, WEIGHTS, 1)
        self.forget()

    def forget(self, sure: float = SURE) -> None:
        """Leave every pixel as it is, as when untrained; less `sure` of it, it is readier to learn."""
        nn.init.zeros_(self.leave.weight)
        nn.init.zeros_(self.leave.bias)
        nn.init.constant_(self.leave.bias[CENTRE], sure)

    def forward(self, seen: Tensor) -> Tensor:
        x = F.silu(self.enter(seen.to(self.enter.weight.dtype)))
        for look in self.look:
            x = x + F.silu(look(x))
        return self.leave(x).softmax(1)


def weighted(picture: Tensor, kernels: Tensor, samples: int = 0) -> Tensor:
    """(V, C, H, W): the mean of every pixel's surroundings under its kernel; the outermost pixels are repeated.

    samples: of a pixel; the more there are than in the training, the less there is to mend.
    """
    kernels = (kernels - LEAST).clamp_min(0) * (SAMPLES[1] / max(samples, SAMPLES[1]))
    h, w = picture.shape[2:]
    padded = F.pad(picture, (RADIUS,) * 4, mode="replicate")
    side = 2 * RADIUS + 1
    moved = torch.zeros_like(picture)  # by differences, so that what is the same all around stays exactly so
    for i in range(WEIGHTS):
        y, x = divmod(i, side)
        if i != CENTRE:
            moved.addcmul_(kernels[:, i, None], padded[..., y:y + h, x:x + w] - picture)
    return picture + moved


def exposure_of(radiance: np.ndarray, guides: Guides) -> float:
    """Of a whole picture as in `seen`, by all that it shows but lamps."""
    return float(key_exposure(torch.from_numpy((radiance + guides.environment).mean(-1).ravel())))


def seen(radiance: np.ndarray, guides: Guides, exposure: float, samples: int) -> Tensor:
    """(1, len(SEEN), H, W) of a picture (H, W, 3) without emitters and world seen directly, in world radiance.

    samples: of a pixel. Where no light was traced, there is none in `traced`.
    """
    traced = np.zeros_like(radiance) if guides.traced is None else guides.traced
    whole = radiance + guides.emission + guides.environment
    light = shown(tensor(np.dstack([whole, guides.emission, traced]) * np.float32(exposure)))
    surface = tensor(np.dstack([guides.diffuse_color, guides.glossy_color, guides.transmission_color,
                                guides.normal * guides.alpha[..., None], guides.alpha]))
    noise = torch.full_like(surface[:, :1], (SAMPLES[0] / np.clip(samples, *SAMPLES)) ** 0.5)
    return torch.cat([light, surface, noise], 1)


def beside_lamps(emission: np.ndarray) -> Tensor:
    """(1, 1, H, W) bool: where a kernel reaches pixels of (H, W, 3) that glow, whose light it would not keep."""
    bright = (tensor(emission).amax(1, keepdim=True) > GLOWS).float()
    return F.max_pool2d(bright, 2 * RADIUS + 1, stride=1, padding=RADIUS) > 0


def antialiased(predictor: KernelPredictor, pictures: dict[str, np.ndarray], radiance: np.ndarray, guides: Guides,
                samples: int, wraps: bool = False) -> dict[str, np.ndarray]:
    """All `pictures` (H, W, C) f32 under the kernels of one, of which `radiance` and `guides` are as in `seen`.

    samples: of a pixel in the first hits and in the traced light. wraps: whether the sides are neighbours.
    """
    if wraps:
        wide = lambda picture: extend_sides(picture, REACH, REACH, wraps)  # noqa: E731
        done = antialiased(predictor, {key: wide(picture) for key, picture in pictures.items()}, wide(radiance),
                           Guides(**{key: wide(guide) for key, guide in guides.arrays().items()}), samples)
        return {key: picture[:, REACH:-REACH] for key, picture in done.items()}
    device, exposure, done = predictor.enter.weight.device, exposure_of(radiance, guides), []
    for outer, inner in bands(*guides.alpha.shape, margin=REACH, pixels=current_pieces().limit(BAND_PIXELS)):
        kernels = predictor(seen(radiance[outer], guides.rows(outer), exposure, samples).to(device))
        kernels = kernels * ~beside_lamps(guides.emission[outer] * np.float32(exposure)).to(device)
        joined = tensor(np.dstack([picture[outer] for picture in pictures.values()])).to(device)
        done.append(weighted(joined, kernels, samples)[0, :, inner].permute(1, 2, 0).cpu().numpy())
    ends = np.cumsum([picture.shape[-1] for picture in pictures.values()])
    return dict(zip(pictures, np.split(np.concatenate(done), ends[:-1], axis=-1), strict=True))


def tensor(picture: np.ndarray) -> Tensor:
    """(H, W, C) -> (1, C, H, W) f32."""
    return torch.from_numpy(np.ascontiguousarray(picture, np.float32)).permute(2, 0, 1)[None]
