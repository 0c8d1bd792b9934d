# SPDX-License-Identifier: GPL-3.0-or-later
"""An endless stream of augmented training samples from a folder that may still be growing."""
from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch.utils.data import DataLoader, IterableDataset, get_worker_info

from renderformer_v2.model.tensor_group import TensorGroup
from tools.datagen import manifest
from tools.datagen.sample_files import Facts, read_facts, sample_paths

from . import ranks
from .augment import augment
from .batch import Batch, Batching, batches
from .config import Stage
from .errors import SampleError, TrainingError
from .samples import LightInputs, TrainingSample, cached_sample, seed_of, unreadable, with_latents

POLL_SECONDS = 1.0  # seconds


class SampleStream(IterableDataset):
    """Epoch after epoch in random order; the folder is read again at every epoch.

    Of `count` streams that differ in nothing but their `index` 0, 1, ... among them, each yields every count-th sample,
    so together, in turn, they yield what one alone would. `seed` is the run's seed and the step at which the stream
    begins, so that a resumed run gets an order of its own.
    `patience` is how many seconds to wait for more samples when none can be used. When they have passed, the stream
    yields a TrainingError, because one that is raised here would reach the reader with a traceback in its message.
    `read` gives the sample of a path, with what is random in it, or raises SampleError.
    """

    def __init__(self, folder: Path, read: Callable[[Path, torch.Generator], TensorGroup], stage: Stage,
                 seed: tuple[int, int], patience: float, index: int = 0, count: int = 1):
        self.folder, self.read, self.stage = folder, read, stage
        self.seed, self.patience, self.index, self.count = seed, patience, index, count
        self.unreadable: set[Path] = set()
        self.useless: set[Path] = set()  # those, and what the stage does not admit
        self.facts: dict[Path, Facts] = {}

    def __iter__(self) -> Iterator[TensorGroup | TrainingError]:
        torch.set_num_threads(1)
        worker, number = get_worker_info(), -1  # of the samples of all streams
        index, count = ((self.index + self.count * worker.id, self.count * worker.num_workers) if worker
                        else (self.index, self.count))
        order = _generator(*self.seed)
        while True:
            paths = sample_paths(self.folder)
            if not self.stage.admits_all():
                self._read_manifest()
            for i in torch.randperm(len(paths), generator=order).tolist():
                if not self._is_admitted(paths[i]):
                    continue
                number += 1
                if number % count != index:
                    continue
                sample = self._sample(paths[i], _generator(*self.seed, number))
                if sample is not None:
                    yield sample
            if self.useless.issuperset(paths):
                if not self._grows(len(paths)):
                    yield TrainingError(self._problem(len(paths)))
                    return
                self.useless.clear()

    def _read_manifest(self) -> None:
        """What it says of samples spares reading them; a line of an older version does not count."""
        for name, entry in manifest.read_entries(self.folder).items():
            try:
                self.facts[self.folder / name] = manifest.facts_from_entry(entry)
            except KeyError:
                continue

    def _is_admitted(self, path: Path) -> bool:
        """The same for all streams, so that they count alike."""
        if self.stage.admits_all():
            return True
        if path not in self.facts:
            try:
                self.facts[path] = read_facts(path)
            except Exception as error:  # a damaged archive raises whatever the damage leads to
                self._leave_out(path, unreadable(path, error))
                return False
        if self.stage.admits(self.facts[path]):
            return True
        self.useless.add(path)
        return False

    def _sample(self, path: Path, generator: torch.Generator) -> TensorGroup | None:
        """None for a file that cannot be read."""
        try:
            sample = self.read(path, generator)
        except SampleError as error:
            self._leave_out(path, error)
            return None
        self.useless.discard(path)
        self.unreadable.discard(path)
        return sample

    def _leave_out(self, path: Path, error: SampleError) -> None:
        """Leave a sample out of this run; its error is printed once."""
        if path not in self.unreadable:
            print(f"{error} (left out)", flush=True)
        self.unreadable.add(path)
        self.useless.add(path)

    def _grows(self, known: int) -> bool:
        """Wait until the folder holds more than `known` samples; whether it does in time."""
        end = time.monotonic() + self.patience
        if self.patience:
            print(f"{self._problem(known)}\nWaiting {self.patience / 60:g} minutes for more", flush=True)
        while len(sample_paths(self.folder)) <= known:
            if time.monotonic() >= end:
                return False
            time.sleep(min(POLL_SECONDS, self.patience))
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


def _generator(*seed: int) -> torch.Generator:
    return torch.Generator().manual_seed(int(np.random.SeedSequence(seed).generate_state(1)[0]))


@dataclass(frozen=True)
class Prepared:
    """Reads samples for the guided network, which are made once and stored in `cache`.

    mapper: of their materials; None leaves them BSDF parameters.
    """

    cache: Path
    mapper: Callable | None
    stage: Stage

    def __call__(self, path: Path, generator: torch.Generator) -> TrainingSample:
        by_scene_alone = bool(torch.rand((), generator=generator) < self.stage.scene)
        light_inputs = LightInputs.SCENE if by_scene_alone else light_inputs_of(path, self.stage.rays)
        sample = cached_sample(path, self.cache, light_inputs)
        sample = augment(sample, generator) if self.stage.augmented else sample
        return sample if self.mapper is None else with_latents(sample, self.mapper)


def light_inputs_of(path: Path, rays: float) -> LightInputs:
    """Light of a sample: a share `rays` of all samples, always the same ones, is without traced light."""
    return LightInputs.RAYS if seed_of(path).random() < rays else LightInputs.TRACED


class BatchStream(IterableDataset):
    """The batches of a stream."""

    def __init__(self, samples: SampleStream, batching: Batching):
        self.samples, self.batching = samples, batching

    def __iter__(self) -> Iterator[Batch | TrainingError]:
        return batches(self.samples, self.batching)


def stream(folder: Path, read: Callable[[Path, torch.Generator], TensorGroup], stage: Stage, seed: tuple[int, int],
           patience: float, workers: int = 1, batching: Batching | None = None) -> Iterator[TensorGroup]:
    """This process's share of a folder, `read` by `workers` other ones, in batches if these are asked for.

    Raises TrainingError without any sample of use.
    """
    if not folder.is_dir():
        raise TrainingError(f"there is no folder {folder}: check --data, "
                            f"or make samples with python -m tools.datagen {folder}")
    samples = SampleStream(folder, read, stage, seed, patience, ranks.rank(), ranks.count())
    dataset = BatchStream(samples, batching) if batching else samples
    pins = batching is not None and torch.cuda.is_available()
    if batching:  # whose tensors would need more open files than a process may have
        torch.multiprocessing.set_sharing_strategy("file_system")
    for sample in DataLoader(dataset, batch_size=None, num_workers=workers, prefetch_factor=4, pin_memory=pins):
        if isinstance(sample, TrainingError):
            raise sample
        yield sample
