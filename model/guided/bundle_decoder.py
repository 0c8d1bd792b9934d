# SPDX-License-Identifier: GPL-3.0-or-later
"""From ray bundles back to their pixels: what the transformer says of the light that they see."""
from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from ..fields import Channels
from ..light.edge_stopping import SIDE, TENT
from ..network.config import ModelConfig
from ..network.layers import Linear, RMSNorm

SAID = Channels(1, log_factor=3)  # of all light, by colour
CELLS = 2          # along a side of a bundle, of which it says something of their own
LARGEST_LOG = 2.0  # factors are between exp(-LARGEST_LOG) and exp(LARGEST_LOG)


class BundleDecoder(nn.Module):
    """Features of ray bundles after the last view layer -> SAID; zeros before it is trained.

    The paper's decoder (`network/decoder.py`) has convolutions without norms, whose gain grew a million times within
    the few minutes of our training; after that all pixels heard the same.
    """

    def __init__(self, config: ModelConfig):
        super().__init__()
        self.norm = RMSNorm(config.view_transformer_latent_dim)
        self.project = Linear(config.view_transformer_latent_dim, len(SAID) * CELLS ** 2)
        for p in self.project.parameters():
            nn.init.zeros_(p)

    def forward(self, features: Tensor) -> Tensor:
        """(V, D, Hg, Wg) -> (V, len(SAID), CELLS Hg, CELLS Wg) f32."""
        said = self.project(self.norm(features.movedim(1, -1))).movedim(-1, 1).float()
        return smoothed(LARGEST_LOG * F.pixel_shuffle(said, CELLS).tanh())


def smoothed(cells: Tensor) -> Tensor:
    """(V, C, h, w): bundles err each for itself, which shows as blotches on plain walls."""
    weights, reach = cells.new_tensor(TENT).expand(cells.shape[1], 1, 1, -1), SIDE // 2
    for _ in range(2):  # along rows, and along columns
        padded = F.pad(cells, (reach, reach, 0, 0), mode="replicate")
        cells = F.conv2d(padded, weights, groups=cells.shape[1]).transpose(2, 3)
    return cells


def at_pixels(cells: Tensor, rows: slice, width: int, cell: int) -> Tensor:
    """Cells (V, C, h, w) of `cell` pixels -> `rows` of the pixels (V, C, H, width), between the middles of cells."""
    first, last = rows.start // cell, -(-rows.stop // cell)
    near = torch.arange(first - 1, last + 1, device=cells.device).clamp(0, cells.shape[2] - 1)
    pixels = F.interpolate(cells[:, :, near], scale_factor=cell, mode="bilinear", align_corners=False)
    begin = rows.start - (first - 1) * cell
    return pixels[..., begin:begin + rows.stop - rows.start, :width]
