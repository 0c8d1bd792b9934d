# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m tools.train.antialiasing --data DIR --start WEIGHTS_DIR --out DIR --minutes M: train a network's edges.

The kernel predictor learns alone, the rest of the network stays as it is. That rest renders every sample of DIR, with
its traced light and without (two seconds), which later runs read again; then the kernel predictor learns from tiles of
those pictures, in memory. The network with its new kernel predictor is written to --out/weights.
"""
from __future__ import annotations

import argparse
import hashlib
import os
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import load_file, save_file
from torch import Tensor, nn
from torch.utils.data import DataLoader, Dataset

from renderformer_v2.model.compute.inference import inference
from renderformer_v2.model.compute.threads import team
from renderformer_v2.model.fields import COLOR, DIRECTION, map_channels
from renderformer_v2.model.guided.exposure import display_encode
from renderformer_v2.model.guided.kernels import (
    INPUTS,
    KernelPredictor,
    apply_kernels,
    kernel_inputs,
    picture_exposure,
    to_tensor,
)
from renderformer_v2.model.guided.network import load_network
from renderformer_v2.model.guided.pipeline import GuidedPipeline
from renderformer_v2.model.pictures import HALF_MAX
from renderformer_v2.model.renderer import Renderer
from renderformer_v2.model.weights.checkpoint import save_network
from renderformer_v2.model.weights.presets import BUNDLED, weights_folder
from tools.common.console import whole_number
from tools.datagen.sample_files import hint_samples, load_with_paths, sample_paths

from . import ranks, sample_cache
from .augment import mirrored, recolored, turn_about_z
from .errors import SampleError, TrainingError
from .run import report_errors
from .samples import unreadable

CHANNELS = len(INPUTS), 4, 4  # inputs of the predictor, the picture and its alpha, and both as they should be
SIDE = 48                   # pixels of a tile
TILES = 16                  # of a step, by all processes together
CENTRE_LOGIT = 5.0          # of a pixel's own weight, to begin with
LEARNING_RATE, WARM_UP, WEIGHT_DECAY = 2e-3, 50, 1e-4
LOSS_WEIGHT = 2.0           # a tile that gets worse counts so many times more than one that gains
LEAST_ERROR = 1e-5          # mean square that counts as none
LOG_EVERY = 100             # steps


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.train.antialiasing", description=__doc__)
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
    with team(options.threads), ranks.join(options):
        return report_errors(lambda: fit(options))


def fit(options: argparse.Namespace) -> None:
    """Raises TrainingError when there is nothing to learn from, or the weights are of another network."""
    torch.manual_seed(options.seed)
    renderer = Renderer(options.start, device="cpu", precision="fp32")
    if not isinstance(renderer.pipeline, GuidedPipeline):
        raise TrainingError(f"{options.start} is a published network, which knows no guides and no edges")
    network = load_network(weights_folder(options.start))
    samples = render_samples(options, network, lambda path: render_sample(renderer, path))
    samples = [sample for sample in samples if min(sample.shape[2:]) >= SIDE]
    if not samples:
        raise TrainingError(f"all pictures in {options.data} are smaller than {SIDE} pixels")
    network.kernel_predictor.requires_grad_(True)
    train(network.kernel_predictor, samples, 60 * options.minutes,
          lambda: save_network(options.out / "weights", network.config, network.state_dict()))


def render_samples(options: argparse.Namespace, network: nn.Module, render: Callable[[Path], Tensor]) -> list[Tensor]:
    """(V, C, h, w) f16 of every sample, by `RenderedFiles`; raises TrainingError if there is none.

    Each process that trains renders its share of them, and reads those of the others.
    """
    files = RenderedFiles(options.data, options.rendered or options.data.parent / "rendered", network, render)
    own, done = range(ranks.rank(), len(files), ranks.count()), {}
    for i, file in zip(own, DataLoader(files, batch_size=None, sampler=own,
                                       num_workers=options.processes or os.cpu_count() or 1)):
        done[i] = file
        if ranks.is_first() and len(done) % 50 == 0:
            print(f"{len(done)} of {len(own)} samples", flush=True)
    done = ranks.gather(done)
    samples = [load_file(done[i])["views"] for i in sorted(done) if done[i] is not None]
    if not samples:
        raise TrainingError(f"{options.data} holds no samples that can be read: make some with tools.datagen")
    return samples


class RenderedFiles(Dataset):
    """Of all samples in a folder, rendered where they are missing or out of date."""

    def __init__(self, data: Path, stored: Path, network: nn.Module, render: Callable[[Path], Tensor]):
        """render: a sample's path -> (V, C, h, w), by all of the network but its kernel predictor."""
        self.paths, self.stored, self.render = sample_paths(data), stored, render
        stored.mkdir(parents=True, exist_ok=True)
        weights = b"".join(p.detach().numpy().tobytes() for name, p in network.named_parameters()
                           if not name.startswith("kernel_predictor."))
        self.network_hash = hashlib.sha256(weights).hexdigest()[:12]

    def __len__(self) -> int:
        return len(self.paths)

    def __getitem__(self, index: int) -> Path | None:
        """The file of one sample; None, and a line that says so, if that cannot be read."""
        torch.set_num_threads(1)
        path = self.paths[index]
        file = self.stored / f"{path.stem}-{self.network_hash}-{sample_cache.sample_key(path)}.safetensors"
        if not file.is_file():
            try:
                with inference():
                    views = self.render(path).clamp(-HALF_MAX, HALF_MAX).half()
            except SampleError as error:
                print(f"{error} (left out)", flush=True)
                return None
            save_file({"views": views.contiguous()}, file.with_suffix(".tmp"))
            file.with_suffix(".tmp").replace(file)
        return file


def render_sample(renderer: Renderer, path: Path) -> Tensor:
    """(2 V, sum(CHANNELS), H, W) of all views of a sample, each with its traced light and without.

    Raises SampleError when it cannot be read.
    """
    try:
        scene, views, guides, passes = load_with_paths(path)
    except Exception as error:  # a damaged archive raises whatever the damage leads to
        raise unreadable(path, error) from error
    encoded, rendered = renderer.encode(scene), []
    variants = ((view, variant, reference) for view, guide, reference in zip(views, guides, passes, strict=True)
                for variant in (guide, replace(guide, traced=None)))
    for view, guide, reference in variants:
        radiance = encoded.view(view, guide)
        ours = np.dstack([radiance + guide.emission + guide.environment, guide.alpha])
        target = reference["combined"] + np.pad(reference["environment"], ((0, 0), (0, 0), (0, 1)))
        exposure = picture_exposure(radiance, guide)
        pictures = to_tensor(np.dstack([ours, target]))
        pictures[:, [0, 1, 2, 4, 5, 6]] *= exposure
        rendered.append(torch.cat([kernel_inputs(radiance, guide, exposure, hint_samples(path)), pictures], 1))
    return torch.cat(rendered)


def train(predictor: KernelPredictor, samples: list[Tensor], seconds: float, write: Callable[[], None]) -> None:
    """Fit a predictor, untrained or not, to samples from `render_sample`; `write()` is called now and then.

    All processes draw the same tiles, and each learns from its share of them.
    """
    if not predictor.leave.weight.any():
        predictor.reset(CENTRE_LOGIT)
    ranks.share(TILES, "parts of a step")

    def compute_gain() -> Tensor:
        gain = tile_gains(predictor, draw_tiles(samples)[ranks.rank()::ranks.count()])
        return (gain + LOSS_WEIGHT * gain.clamp_max(0)).mean()

    optimizer = torch.optim.AdamW((p for p in predictor.parameters() if p.requires_grad), LEARNING_RATE,
                                  weight_decay=WEIGHT_DECAY)
    begin, step, gains = time.monotonic(), 0, []
    predictor.train()
    compute_gain = ranks.with_shared_gradients(predictor, compute_gain)

    def save() -> None:
        if ranks.is_first():
            write()

    while (rate_share := ranks.broadcast(1 - (time.monotonic() - begin) / seconds)) > 0:
        optimizer.param_groups[0]["lr"] = LEARNING_RATE * min(1, (step + 1) / WARM_UP) * rate_share
        gain = compute_gain()
        optimizer.zero_grad()
        (-gain).backward()
        optimizer.step()
        step, gains = step + 1, [*gains, ranks.compute_means({"gain": gain})["gain"]]
        if step % LOG_EVERY == 0:
            if ranks.is_first():
                print(f"step {step}: {sum(gains) / len(gains):.3f} dB gained", flush=True)
            gains = []
            save()
    save()


def draw_tiles(samples: list[Tensor]) -> Tensor:
    """(TILES, sum(CHANNELS), SIDE, SIDE) f32 of random samples, augmented."""
    tiles = []
    for i in torch.randint(len(samples), (TILES,)).tolist():
        view, top, left = (int(torch.randint(n, ())) for n in (
            len(samples[i]), *(size - SIDE + 1 for size in samples[i].shape[2:])))
        tiles.append(samples[i][view, :, top:top + SIDE, left:left + SIDE])
    return augment_tiles(torch.stack(tiles).float())


def augment_tiles(tiles: Tensor) -> Tensor:
    """Tiles (N, sum(CHANNELS), h, w) turned about Z, recoloured and mirrored, all alike."""
    order, turn = torch.randperm(3), turn_about_z(float(torch.rand(())) * 2 * torch.pi)
    inputs, ours, target = tiles.split(CHANNELS, 1)
    inputs = map_channels(inputs, INPUTS, {COLOR: recolored(order), DIRECTION: turn})
    order = torch.cat([order, torch.tensor([3])])
    return mirrored(torch.cat([inputs, ours[:, order], target[:, order]], 1))


def tile_gains(predictor: KernelPredictor, tiles: Tensor) -> Tensor:
    """(N,) decibels by which the predicted kernels bring tiles (N, sum(CHANNELS), h, w) closer to their targets."""
    inputs, ours, target = tiles.split(CHANNELS, 1)
    before, after, target = (torch.cat([display_encode(picture[:, :3]), picture[:, 3:]], 1)
                             for picture in (ours, apply_kernels(ours, predictor(inputs)), target))
    errors = ((picture - target).square().mean((1, 2, 3)) + LEAST_ERROR for picture in (before, after))
    return 10 * (torch.log10(next(errors)) - torch.log10(next(errors)))


if __name__ == "__main__":
    sys.exit(main())
