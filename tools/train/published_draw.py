# SPDX-License-Identifier: GPL-3.0-or-later
"""What a step of training sees of a published sample: some of its views, crops of them, somewhere else in the world.

Scenes without an environment are turned about any axis at every step, others once for each of their copies.
"""
from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from renderformer_v2.model.fields import POINT, map_arrays
from renderformer_v2.model.network.inputs import ViewInputs

from .augment import rotation, turned
from .config import Stage
from .published_samples import Encoded, PublishedSample


@dataclass(frozen=True)
class Drawn:
    """Reads samples as a stage wants them."""

    encoded: Encoded
    stage: Stage
    side: int       # pixels: crops begin at multiples of it (ModelConfig.granularity)
    offset: float   # network units, standard deviation along each axis

    def __call__(self, path: Path, generator: torch.Generator) -> PublishedSample:
        """Raises SampleError for a sample that was not prepared."""
        sample = self.encoded(path, generator)
        chosen = torch.randperm(len(sample.image), generator=generator)[:self.stage.views]
        sample = with_views(sample, chosen)
        if self.stage.crop:
            sample = cropped(sample, self.stage.crop, self.side, generator)
        if self.encoded.copies > 1 and not sample.inputs.environment.strength.any():
            sample = map_arrays(sample, turned(rotation(torch.randn(3, generator=generator))))
        return moved(sample, self.offset * torch.randn(3, generator=generator))


def with_views(sample: PublishedSample, chosen: Tensor) -> PublishedSample:
    """Only those views, in this order."""
    rays = ViewInputs(sample.rays.origin[chosen], sample.rays.directions[chosen])
    return replace(sample, rays=rays, image=sample.image[chosen], mask=sample.mask[chosen])


def cropped(sample: PublishedSample, size: int, side: int, generator: torch.Generator) -> PublishedSample:
    """A square of each view, or all of a smaller one, that begins at a random multiple of `side`; with its own rays."""
    shape = sample.mask.shape[2:]
    starts = [[side * int(torch.randint(max(whole - size, 0) // side + 1, (), generator=generator)) for whole in shape]
              for _ in sample.mask]

    def cut(pictures: Tensor) -> Tensor:
        """(V, C, H, W)."""
        return torch.stack([view[:, y:y + size, x:x + size] for view, (y, x) in zip(pictures, starts, strict=True)])

    directions = cut(sample.rays.directions.movedim(-1, 1)).movedim(1, -1)
    return replace(sample, rays=ViewInputs(sample.rays.origin, directions), image=cut(sample.image),
                   mask=cut(sample.mask))


def moved(sample: PublishedSample, offset: Tensor) -> PublishedSample:
    """Scene and cameras moved by (3,): the pictures stay the same."""
    return map_arrays(sample, {POINT: lambda x: x + offset})
