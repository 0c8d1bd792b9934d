# SPDX-License-Identifier: GPL-3.0-or-later
"""An endless stream of augmented training samples from a folder that may still be growing."""
from __future__ import annotations

from pathlib import Path

import torch
from torch.utils.data import DataLoader, IterableDataset

from tools.datagen.shards import sample_paths

from .augment import augment
from .config import Stage
from .samples import TrainingSample, cached_sample, with_latents


class SampleStream(IterableDataset):
    """Epoch after epoch in random order; the folder is read again at every epoch."""

    def __init__(self, folder: Path, cache: Path, mapper, stage: Stage, seed: int):
        self.folder, self.cache, self.mapper, self.stage, self.seed = folder, cache, mapper, stage, seed

    def __iter__(self):
        torch.set_num_threads(1)
        generator = torch.Generator().manual_seed(self.seed)
        while True:
            paths = sample_paths(self.folder)
            for i in torch.randperm(len(paths), generator=generator).tolist():
                sample = cached_sample(paths[i], self.cache)
                if admitted(sample, self.stage):
                    yield with_latents(augment(sample, generator), self.mapper)


def admitted(sample: TrainingSample, stage: Stage) -> bool:
    """Whether this scene belongs to this stage of the curriculum."""
    glass = bool((sample.guides.colors[:, 2].amax() > 0.01))
    return (len(sample.inputs.triangles) <= stage.max_triangles and (stage.volumes or sample.inputs.volumes is None)
            and (stage.transmission or not glass))


def stream(folder: Path, cache: Path, mapper, stage: Stage, seed: int) -> DataLoader:
    """Samples prepared in a process of their own."""
    cache.mkdir(parents=True, exist_ok=True)
    samples = SampleStream(folder, cache, mapper, stage, seed)
    return DataLoader(samples, batch_size=None, num_workers=1, prefetch_factor=4)
