# SPDX-License-Identifier: GPL-3.0-or-later
"""An endless stream of augmented training samples from a folder that may still be growing."""
from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from torch.utils.data import DataLoader, IterableDataset

from tools.datagen.shards import sample_paths

from .augment import augment
from .config import Stage
from .errors import SampleError, TrainingError
from .samples import TrainingSample, cached_sample, with_latents

LOOK_AGAIN = 1.0  # seconds


class SampleStream(IterableDataset):
    """Epoch after epoch in random order; the folder is read again at every epoch.

    `seed` is the run's seed and the step at which the stream begins, so that a resumed run gets an order of its own.
    `patience` is how many seconds to wait for more samples when none can be used. When they have passed, the stream
    yields a TrainingError, because one that is raised here would reach the reader with a traceback in its message.
    """

    def __init__(self, folder: Path, cache: Path, mapper, stage: Stage, seed: tuple[int, int], patience: float):
        self.folder, self.cache, self.mapper, self.stage = folder, cache, mapper, stage
        self.seed, self.patience, self.unreadable = seed, patience, set()

    def __iter__(self) -> Iterator[TrainingSample | TrainingError]:
        torch.set_num_threads(1)
        generator = torch.Generator().manual_seed(int(np.random.SeedSequence(self.seed).generate_state(1)[0]))
        while True:
            paths, useful = sample_paths(self.folder), 0
            for i in torch.randperm(len(paths), generator=generator).tolist():
                hinted = bool(torch.rand((), generator=generator) >= self.stage.unhinted)
                sample = self._sample(paths[i], hinted)
                if sample is not None and admitted(sample, self.stage):
                    useful += 1
                    yield with_latents(augment(sample, generator), self.mapper)
            if not useful and not self._grows(len(paths)):
                yield TrainingError(self._problem(len(paths)))
                return

    def _sample(self, path: Path, hinted: bool) -> TrainingSample | None:
        """None for a file that cannot be read, which is said once."""
        try:
            sample = cached_sample(path, self.cache, hinted)
        except SampleError as error:
            if path not in self.unreadable:
                print(f"{error} (left out)", flush=True)
            self.unreadable.add(path)
            return None
        self.unreadable.discard(path)
        return sample

    def _grows(self, known: int) -> bool:
        """Wait until the folder holds more than `known` samples; whether it does in time."""
        end = time.monotonic() + self.patience
        if self.patience:
            print(f"{self._problem(known)}\nWaiting {self.patience / 60:g} minutes for more", flush=True)
        while len(sample_paths(self.folder)) <= known:
            if time.monotonic() >= end:
                return False
            time.sleep(min(LOOK_AGAIN, self.patience))
        return True

    def _problem(self, count: int) -> str:
        if not count:
            return (f"{self.folder} holds no samples (scene_*.npz): check --data, "
                    f"or make some with python -m tools.datagen {self.folder}")
        if count == len(self.unreadable):
            return (f"none of the {count} samples of {self.folder} can be read: delete them, "
                    f"and make them again with python -m tools.datagen {self.folder}")
        return (f"none of the {count} samples of {self.folder} is within the limits of the curriculum's {self.stage}: "
                "make more of them, or change the stages of --config")


def admitted(sample: TrainingSample, stage: Stage) -> bool:
    """Whether this scene belongs to this stage of the curriculum."""
    glass = bool(sample.view.guides.colors[:, 2].amax() > 0.01)
    return (len(sample.inputs.triangles) <= stage.max_triangles and (stage.volumes or sample.inputs.volumes is None)
            and (stage.transmission or not glass))


def stream(folder: Path, cache: Path, mapper, stage: Stage, seed: tuple[int, int],
           patience: float) -> Iterator[TrainingSample]:
    """Samples prepared in a process of their own. Raises TrainingError when there are none of use."""
    if not folder.is_dir():
        raise TrainingError(f"there is no folder {folder}: check --data, "
                            f"or make samples with python -m tools.datagen {folder}")
    cache.mkdir(parents=True, exist_ok=True)
    samples = SampleStream(folder, cache, mapper, stage, seed, patience)
    for sample in DataLoader(samples, batch_size=None, num_workers=1, prefetch_factor=4):
        if isinstance(sample, TrainingError):
            raise sample
        yield sample
