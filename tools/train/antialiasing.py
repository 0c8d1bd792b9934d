# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m tools.train.antialiasing --data DIR --start WEIGHTS_DIR --out DIR --minutes M: train a network's edges.

All the rest of the network stays as it is. It renders every sample of DIR, with its traced light and without (two
seconds), which is kept and read again by the next run; then the kernel predictor learns from parts of those pictures,
in memory. The network with its new kernel predictor is written to --out/weights.
"""
from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from renderformer_v2.model.fields import COLOR, DIRECTION, map_channels
from renderformer_v2.model.guided.exposure import shown
from renderformer_v2.model.guided.kernels import SEEN, KernelPredictor, exposure_of, seen, tensor, weighted
from renderformer_v2.model.guided.network import load_network
from renderformer_v2.model.guided.pipeline import GuidedPipeline
from renderformer_v2.model.renderer import Renderer
from renderformer_v2.model.weights.checkpoint import save_network
from renderformer_v2.model.weights.presets import weights_folder
from tools.datagen.sample_files import hint_samples, load_sample

from . import apart, ranks
from .augment import mirrored, recolored, turn_about_z
from .errors import TrainingError
from .samples import unreadable

CHANNELS = len(SEEN), 4, 4  # what is seen, the picture and its alpha, and both as they should be
SIDE = 48                   # pixels of a part
PARTS = 16                  # at a time, by all processes together
SURE = 5.0                  # of the pixel itself, to begin with
WEIGHT_DECAY = 1e-4
HARM = 2.0                  # what a part loses counts so many times more than what another gains


def pixels(renderer: Renderer, path: Path) -> Tensor:
    """(2 V, sum(CHANNELS), H, W) of all views of a sample, each with its traced light and without.

    Raises SampleError when it cannot be read.
    """
    try:
        scene, views, guides, passes = load_sample(path)
    except Exception as error:  # a damaged archive raises whatever the damage leads to
        raise unreadable(path, error) from error
    encoded, found = renderer.encode(scene), []
    both = ((view, used, reference) for view, guide, reference in zip(views, guides, passes, strict=True)
            for used in (guide, replace(guide, traced=None)))
    for view, guide, reference in both:
        radiance = encoded.view(view, guide)
        ours = np.dstack([radiance + guide.emission + guide.environment, guide.alpha])
        wanted = reference["combined"] + np.pad(reference["environment"], ((0, 0), (0, 0), (0, 1)))
        exposure = exposure_of(radiance, guide)
        pictures = tensor(np.dstack([ours, wanted]))
        pictures[:, [0, 1, 2, 4, 5, 6]] *= exposure
        found.append(torch.cat([seen(radiance, guide, exposure, hint_samples(path)), pictures], 1))
    return torch.cat(found)


def augmented(parts: Tensor) -> Tensor:
    """Parts (N, sum(CHANNELS), h, w) turned about Z, recoloured and mirrored, all alike."""
    order, turn = torch.randperm(3), turn_about_z(float(torch.rand(())) * 2 * torch.pi)
    known, ours, wanted = parts.split(CHANNELS, 1)
    known = map_channels(known, SEEN, {COLOR: recolored(order), DIRECTION: turn})
    order = torch.cat([order, torch.tensor([3])])
    return mirrored(torch.cat([known, ours[:, order], wanted[:, order]], 1))


def train(predictor: KernelPredictor, samples: list[Tensor], seconds: float, write) -> None:
    """Fit a predictor, untrained or not, to `pixels` of samples; `write()` is called in between and in the end.

    All processes draw the same parts, and each learns from its share of them.
    """
    if not predictor.leave.weight.any():
        predictor.forget(SURE)
    ranks.share(PARTS, "parts of a step")

    def display(picture: Tensor) -> Tensor:
        return torch.cat([shown(picture[:, :3]), picture[:, 3:]], 1)

    def gained() -> Tensor:
        chosen = (samples[i] for i in torch.randint(len(samples), (PARTS,)).tolist())
        parts = torch.stack([_part(sample) for sample in chosen])
        own = augmented(parts.float())[ranks.rank()::ranks.count()]
        known, ours, wanted = own.split(CHANNELS, 1)
        gain = apart.decibels(*map(display, (weighted(ours, predictor(known)), ours, wanted)))
        return gain + HARM * gain.clamp_max(0)

    apart.gain_decibels(predictor, gained, seconds, WEIGHT_DECAY, write)


def _part(sample: Tensor) -> Tensor:
    """(C, SIDE, SIDE) somewhere in one of its views."""
    view, top, left = (int(torch.randint(n, ())) for n in (
        len(sample), *(size - SIDE + 1 for size in sample.shape[2:])))
    return sample[view, :, top:top + SIDE, left:left + SIDE]


def fit(options: argparse.Namespace) -> None:
    """Raises TrainingError when there is nothing to learn from, or the weights are of another network."""
    torch.manual_seed(options.seed)
    renderer = Renderer(options.start, device="cpu", precision="fp32")
    if not isinstance(renderer.pipeline, GuidedPipeline):
        raise TrainingError(f"{options.start} is a published network, which knows no guides and no edges")
    network = load_network(weights_folder(options.start))
    samples = apart.rendered(options, network, ("kernel_predictor",), lambda path: pixels(renderer, path))
    samples = [sample for sample in samples if min(sample.shape[2:]) >= SIDE]
    if not samples:
        raise TrainingError(f"all pictures in {options.data} are smaller than {SIDE} pixels")
    network.kernel_predictor.requires_grad_(True)
    train(network.kernel_predictor, samples, 60 * options.minutes,
          lambda: save_network(options.out / "weights", network.config, network.state_dict()))


def main() -> int:
    return apart.command("antialiasing", __doc__, fit)


if __name__ == "__main__":
    sys.exit(main())
