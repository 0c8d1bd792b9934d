# SPDX-License-Identifier: GPL-3.0-or-later
"""Views as smaller pictures would show them, for the ray bundles of large ones.

What ray bundles say is about light and not about pixels, and the network was trained with small pictures. So bundles
of large ones see as much of a scene as those of small ones, not a speck of wall; and they are fewer.
"""
from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from ..fields import Layout, map_layouts
from ..network.config import ModelConfig
from ..progress import report
from .features import OFFSET_SCALE, SAMPLES, SURFACE, GuidedView, noise_of

LONGEST = 256  # pixels of a side up to which nothing is reduced
LARGEST = 8    # reduction; a power of two, so that bundles of all rectangles of a picture begin at the same pixels
LEAST_NOISE = float(noise_of(np.float32(SAMPLES[1])))


def reduction_of(longer_side: int) -> int:
    """Pixels along a side of the square that becomes one pixel, in a picture with such a longer side."""
    reduction = 1
    while reduction < LARGEST and longer_side > reduction * LONGEST:
        reduction *= 2
    return reduction


def reduced(view: GuidedView, reduction: int, config: ModelConfig) -> GuidedView:
    """The means of squares of pixels, and what lies at the edge repeated up to the end of the network's window."""
    if reduction == 1:
        return view
    patch, (height, width) = config.patch_size, view.surface.shape[2:]
    around = [size // reduction for size in (height, width)]
    margins = [-size % config.granularity for size in around]

    def means(pixels: Tensor) -> Tensor:
        """(V, C, H, W) -> (V, C, h, w)."""
        return F.pad(F.avg_pool2d(pixels, reduction), (0, margins[1], 0, margins[0]), mode="replicate")

    def smaller(field: Tensor, layout: Layout) -> Tensor:
        report()
        if "H" not in layout.shape:
            return field
        axis = layout.shape.index("H")
        pixels = field.movedim((axis, axis + 1), (-2, -1))
        pixels = means(pixels.flatten(1, -3)).unflatten(1, pixels.shape[1:-2])
        return pixels.movedim((-2, -1), (axis, axis + 1))

    bundles = view.positions.transpose(1, 2).unflatten(2, (height // patch, width // patch))
    is_covered = (view.surface[:, SURFACE["alpha"]] > 0).float()
    position = repeated(bundles, patch) + view.surface[:, SURFACE["offset"]] / OFFSET_SCALE
    hit, share = means(torch.cat([position * is_covered, is_covered], 1)).split([3, 1], 1)
    of_bundles = F.avg_pool2d(torch.cat([hit, share], 1), patch)
    bundles = torch.where(of_bundles[:, 3:] > 0, of_bundles[:, :3] / of_bundles[:, 3:].clamp_min(1e-6),
                          F.avg_pool2d(means(repeated(bundles, patch)), patch))
    offset = (hit / share.clamp_min(1e-6) - repeated(bundles, patch)) * OFFSET_SCALE * (share > 0)

    view = map_layouts(view, smaller)
    surface = {name: view.surface[:, SURFACE[name]] for name in SURFACE.parts}
    surface |= {"offset": offset, "noise": (surface["noise"] / reduction).clamp_min(LEAST_NOISE)}
    surface |= {name: F.normalize(surface[name], dim=1, eps=1e-3) for name in ("normal", "mirrored")}
    return replace(view, directions=F.normalize(view.directions, dim=-1),
                   positions=bundles.flatten(2).transpose(1, 2), surface=torch.cat(list(surface.values()), 1))


def repeated(pixels: Tensor, side: int) -> Tensor:
    """(V, C, h, w), each pixel as a square of them."""
    return pixels.repeat_interleave(side, 2).repeat_interleave(side, 3)
