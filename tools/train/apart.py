# SPDX-License-Identifier: GPL-3.0-or-later
"""Small parts of the network that are trained apart, from memory, on what all the rest makes of the samples."""
from __future__ import annotations

import argparse
import hashlib
import os
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import torch
from safetensors.torch import load_file, save_file
from torch import Tensor, nn
from torch.utils.data import DataLoader, Dataset

from renderformer_v2.model.color import HALF_MAX
from renderformer_v2.model.compute.threads import team
from renderformer_v2.model.weights.presets import BUNDLED
from tools.common.arguments import whole_number
from tools.datagen.sample_files import sample_paths

from . import ranks
from . import sample_cache as cache_key
from .errors import SampleError, TrainingError
from .run import explained

LEARNING_RATE, WARM_UP = 2e-3, 50
LEAST_ERROR = 1e-5     # mean square that counts as none
LOG_EVERY = 100        # steps


def command(name: str, description: str, fit: Callable[[argparse.Namespace], None]) -> int:
    """The command line of such a training; returns its exit status, which is 2 for what the user can put right."""
    parser = argparse.ArgumentParser(prog=f"python -m tools.train.{name}", description=description)
    parser.add_argument("--data", type=Path, required=True, help="folder of samples")
    parser.add_argument("--start", default=BUNDLED, metavar="WEIGHTS_DIR", help=f"default: {BUNDLED}")
    parser.add_argument("--rendered", type=Path, help="what is learnt from (default: DATA/../rendered)")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--minutes", type=float, required=True, help="of training, after the samples were rendered")
    parser.add_argument("--processes", type=whole_number(0), default=0, help="that render (default: one per core)")
    parser.add_argument("--threads", type=whole_number(0), default=0, help="that train (default: all)")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    options.device = "cpu"
    with team(options.threads), ranks.joined(options):
        return explained(lambda: fit(options))


def rendered(options: argparse.Namespace, network: nn.Module, apart: Iterable[str],
             render: Callable[[Path], Tensor]) -> list[Tensor]:
    """(V, C, h, w) f16 of every sample, as `RenderedFiles` has it; raises TrainingError if there is none.

    Each process that trains renders its share of them, and reads those of the others.
    """
    files = RenderedFiles(options.data, options.rendered or options.data.parent / "rendered", network, apart, render)
    own, done = range(ranks.rank(), len(files), ranks.count()), {}
    for i, file in zip(own, DataLoader(files, batch_size=None, sampler=own,
                                       num_workers=options.processes or os.cpu_count() or 1)):
        done[i] = file
        if ranks.first() and len(done) % 50 == 0:
            print(f"{len(done)} of {len(own)} samples", flush=True)
    done = ranks.gathered(done)
    found = [load_file(done[i])["views"] for i in sorted(done) if done[i] is not None]
    if not found:
        raise TrainingError(f"{options.data} holds no samples that can be read: make some with tools.datagen")
    return found


class RenderedFiles(Dataset):
    """Of all samples in a folder, made where they are missing or out of date."""

    def __init__(self, data: Path, stored: Path, network: nn.Module, apart: Iterable[str],
                 render: Callable[[Path], Tensor]):
        """render: a sample's path -> (V, C, h, w), by the network without the parts that are called `apart`."""
        self.paths, self.stored, self.render = sample_paths(data), stored, render
        stored.mkdir(parents=True, exist_ok=True)
        weights = b"".join(p.detach().numpy().tobytes() for name, p in network.named_parameters()
                           if name.partition(".")[0] not in apart)
        self.made_by = hashlib.sha256(weights).hexdigest()[:12]

    def __len__(self) -> int:
        return len(self.paths)

    def __getitem__(self, index: int) -> Path | None:
        """The file of one sample; None, and a line that says so, if that cannot be read."""
        torch.set_num_threads(1)
        path = self.paths[index]
        file = self.stored / f"{path.stem}-{self.made_by}-{cache_key.key(path)}.safetensors"
        if not file.is_file():
            try:
                with torch.inference_mode():
                    views = self.render(path).clamp(-HALF_MAX, HALF_MAX).half()
            except SampleError as error:
                print(f"{error} (left out)", flush=True)
                return None
            save_file({"views": views.contiguous()}, file.with_suffix(".tmp"))
            file.with_suffix(".tmp").replace(file)
        return file


def decibels(after: Tensor, before: Tensor, wanted: Tensor) -> Tensor:
    """(V,) by how much pictures (V, C, h, w) have come closer to what is wanted."""
    errors = ((x - wanted).square().mean((1, 2, 3)) + LEAST_ERROR for x in (before, after))
    return 10 * (torch.log10(next(errors)) - torch.log10(next(errors)))


def gain_decibels(part: nn.Module, gained: Callable[[], Tensor], seconds: float, weight_decay: float, write) -> None:
    """Train a part by what is `gained()` at every step; `write()` is called in between and in the end.

    With several processes `gained()` is of each one's share of a step.
    """
    optimizer = torch.optim.AdamW((p for p in part.parameters() if p.requires_grad), LEARNING_RATE,
                                  weight_decay=weight_decay)
    begin, step, log = time.monotonic(), 0, []
    part.train()
    mean_gain = ranks.with_shared_gradients(part, lambda: gained().mean())

    def save() -> None:
        if ranks.first():
            write()

    while (left := ranks.agreed(1 - (time.monotonic() - begin) / seconds)) > 0:
        optimizer.param_groups[0]["lr"] = LEARNING_RATE * min(1, (step + 1) / WARM_UP) * left
        gain = mean_gain()
        optimizer.zero_grad()
        (-gain).backward()
        optimizer.step()
        step, log = step + 1, [*log, ranks.means({"gain": gain})["gain"]]
        if step % LOG_EVERY == 0:
            if ranks.first():
                print(f"step {step}: {sum(log) / len(log):.3f} dB gained", flush=True)
            log = []
            save()
    save()
