# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m tools.train.network --data DIR --out DIR --minutes M: train the guided network on tools.datagen samples.

Resumes from DIR/state.safetensors, or from the one before it if that is damaged, and may run for days: the learning
rate stays constant after the warm-up and falls to zero during the last --cooldown minutes. DIR/weights holds the
running average, ready for `--weights DIR/weights`.
"""
from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import torch
from safetensors.torch import load_file

from renderformer_v2.model.guided.decoding import OUTPUTS, corrected_light
from renderformer_v2.model.guided.kernels import antialiased_views
from renderformer_v2.model.guided.network import GuidedRenderFormer, new_network
from renderformer_v2.model.material.mappers import load_material_mapper
from renderformer_v2.model.weights.checkpoint import save_network
from tools.common.console import whole_number

from . import ranks
from .batch import Batch, Batching, embed, render_batch
from .captured import CapturedLosses
from .config import Stage, TrainConfig, iterate_stages
from .errors import TrainingError
from .loader import Prepared, stream
from .losses import image_loss, lobe_loss, perceptual_term
from .run import add_arguments, run, run_command
from .samples import TrainingSample, with_latents
from .state import TrainingState

BEFORE_KERNELS = 0.2  # weight of the loss of pictures before the kernels


def sample_loss(model: GuidedRenderFormer, sample: TrainingSample, perceptual) -> dict[str, torch.Tensor]:
    """Losses of all views of one scene: of finished pictures, of those before the kernels, and of the lobes' light."""
    return picture_losses(model, model.render_view(model.encode_scene(sample.inputs), sample.view), sample, perceptual)


def batch_loss(model: GuidedRenderFormer, batch: Batch, mapper, perceptual,
               captured: CapturedLosses | None = None) -> dict[str, torch.Tensor]:
    """`sample_loss` of all views of a batch, whose materials are mapped here, where a card does it."""
    batch = batch.restored()
    batch = replace(batch, sample=with_latents(batch.sample, mapper))
    tokens = embed(model, batch)
    return embedded_loss(model, tokens, batch, perceptual) if captured is None else captured(tokens, batch)


def embedded_loss(model: GuidedRenderFormer, tokens: torch.Tensor, batch: Batch,
                  perceptual) -> dict[str, torch.Tensor]:
    """The same where the scenes' tokens are embedded already."""
    return picture_losses(model, render_batch(model, tokens, batch), batch.sample, perceptual)


def picture_losses(model: GuidedRenderFormer, decoded: torch.Tensor, sample: TrainingSample,
                   perceptual) -> dict[str, torch.Tensor]:
    """Losses of what `render_view` gave for the views of a sample."""
    view = sample.view
    light = corrected_light(decoded, view)
    radiance = light.radiance()
    finished = antialiased_views(model.kernel_predictor, radiance, view, decoded[:, OUTPUTS["latent"]])
    # Traced light contains the indirect light of the specular lobes in part, and never that of the diffuse lobe.
    is_traced = light.is_traced.view(-1, 1, 1, 1, 1) > 0
    is_specular = torch.arange(3, device=light.albedo.device).view(1, 3, 1, 1, 1) > 0
    untraced = light.albedo * ~(is_traced & is_specular)
    losses = {"finished": image_loss(finished, sample.finished, perceptual),
              "image": BEFORE_KERNELS * image_loss(radiance, sample.image, perceptual),
              "direct": lobe_loss(light.direct, sample.direct, light.albedo * ~is_traced),
              "indirect": lobe_loss(light.indirect(), sample.indirect, untraced)}
    return losses | {"total": sum(losses.values())}


def train(options: argparse.Namespace, config: TrainConfig) -> None:
    """Raises TrainingError when there is nothing to train with, or when training has gone wrong."""
    device = torch.device(options.device)
    if options.capture and (device.type != "cuda" or options.batch == 1 or ranks.count() > 1):
        raise TrainingError("--capture is for one process with --batch on a CUDA device: leave it out")
    torch.manual_seed(options.seed)
    model = new_network(config.model()).to(device).train()
    config.train(model)
    if options.start:
        start_from(model, options.start)
    state = TrainingState(model, config.learning_rate, config.weight_decay, config.average_decay, config.muon,
                          config.muon_rate)
    perceptual = perceptual_term(device)
    mapper = load_material_mapper()
    is_batched, lengths = options.batch > 1, tuple(options.capture)
    captured = CapturedLosses(model, partial(embedded_loss, model, perceptual=perceptual), lengths) if lengths else None

    def scenes(stage: Stage) -> Iterator[TrainingSample | Batch]:
        read = Prepared(options.cache, None if is_batched else mapper, stage)
        batching = Batching(options.batch, model.config, lengths) if is_batched else None
        return stream(options.data, read, stage, (options.seed, state.step), options.wait * 60, options.workers,
                      batching)

    def losses(sample: TrainingSample | Batch) -> dict[str, torch.Tensor]:
        if is_batched:
            return batch_loss(model, sample, mapper, perceptual, captured)
        return sample_loss(model, sample, perceptual)

    mapper = mapper.to(device) if is_batched else mapper
    run(state, config, options, iterate_stages(config, state, scenes), losses,
        lambda: save_network(options.out / "weights", model.config, state.average), options.batch)


def start_from(model: GuidedRenderFormer, folder: Path) -> None:
    """Take over the weights in folder/model.safetensors; inputs and outputs that only `model` has start at zero.

    Modules of which there is nothing there stay as they are, such as new layers of a decoder. Raises TrainingError when
    a tensor is missing there for another reason, or has another shape than fewer inputs or outputs explain.
    """
    stored = load_file(folder / "model.safetensors")
    modules = {_module_of(name) for name in stored}
    with torch.no_grad():
        for name, p in model.named_parameters():
            if _module_of(name) not in modules:
                continue
            if name not in stored:
                raise TrainingError(f"{folder} has no {name}: it holds another network")
            values = stored[name].to(p)
            if not _fits_into(values, p):
                raise TrainingError(f"{folder}: {name} has shape {tuple(values.shape)}, not {tuple(p.shape)}")
            p.zero_()
            p[tuple(slice(size) for size in values.shape[:2])] = values


def _module_of(name: str) -> str:
    """The part of the network that the tensor belongs to, such as "pixel_decoder.coarse"."""
    return ".".join(name.split(".")[:2])


def _fits_into(values: torch.Tensor, p: torch.Tensor) -> bool:
    """Whether the shapes are equal, or either the outputs or the inputs, the first two axes, are fewer."""
    is_fewer = [few < many for few, many in zip(values.shape[:2], p.shape) if few != many]
    return values.ndim == p.ndim and values.shape[2:] == p.shape[2:] and is_fewer in ([], [True])


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.train.network", description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder of samples, may still be growing")
    parser.add_argument("--cache", type=Path, help="prepared samples (default: DATA/../cache)")
    parser.add_argument("--start", type=Path, metavar="WEIGHTS_DIR", help="begin with these weights: fine-tuning")
    parser.add_argument("--batch", type=whole_number(1), default=1, metavar="N",
                        help="scenes that are computed together, which is what cards are fast with (default 1)")
    parser.add_argument("--capture", type=whole_number(1), nargs="+", default=(), metavar="LENGTH",
                        help="with --batch: pad sequences of tokens to the least of these lengths, and compute them as "
                             "CUDA graphs (longer ones as they are)")
    parser.add_argument("--wait", type=float, default=5.0, help="minutes, for samples where there are none of use yet")
    add_arguments(parser, "rf2_small.json")
    options = parser.parse_args()
    options.cache = options.cache or options.data.parent / "cache"
    return run_command(train, options)


if __name__ == "__main__":
    sys.exit(main())
