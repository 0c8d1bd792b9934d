# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m tools.train.published --data DIR --start BUNDLE_DIR --out DIR --minutes M: fine-tune a published bundle.

Trains the transformer that renders pictures of the samples' size. DIR/bundle holds its running average beside the
bundle's other files, ready for `--weights DIR/bundle`; BUNDLE_DIR is only read. Resumes as tools.train.network does.
"""
from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import torch
from safetensors.torch import save_file

from renderformer_v2.model.errors import CheckpointError
from renderformer_v2.model.guided.network import new_network
from renderformer_v2.model.network.config import ModelConfig
from renderformer_v2.model.network.renderformer import RenderFormer
from renderformer_v2.model.published.bundle_files import MODEL_CONFIG, TRANSFORMERS, is_transformer
from renderformer_v2.model.published.image_encoder import find_vae
from renderformer_v2.model.published.pipeline import PublishedPipeline
from renderformer_v2.model.weights.files import FORMAT

from . import ranks
from .config import Stage, TrainConfig, iterate_stages
from .errors import TrainingError
from .loader import stream
from .losses import log_radiance, paper_loss, perceptual_term
from .new_bundle import WEIGHTS, new_transformer
from .published_draw import Drawn
from .published_samples import Encoded, PublishedSample, picture_size
from .run import add_arguments, run, run_command
from .state import TrainingState


def sample_loss(network: RenderFormer, sample: PublishedSample, perceptual) -> dict[str, torch.Tensor]:
    """Loss of all views of one scene, where the picture is known.

    Log images are compared, so that what the network draws below zero has gradients, too.
    """
    log_image = network.render_view(network.encode_scene(sample.inputs), sample.rays)
    return {"total": paper_loss(log_image.float() * sample.mask, log_radiance(sample.image), perceptual)}


def train(options: argparse.Namespace, config: TrainConfig) -> None:
    """Raises TrainingError when there is nothing to train with, CheckpointError for an incomplete bundle."""
    device, bundle = torch.device(options.device), options.out / "bundle"
    if bundle.resolve() == options.start.resolve():
        raise TrainingError(f"{bundle} would be overwritten: choose another --out than its own")
    if is_transformer(options.start):
        raise TrainingError(f"{options.start} is one transformer by itself: --start needs a whole renderformer-v2")
    torch.manual_seed(options.seed)
    pipeline = PublishedPipeline(options.start, device, torch.float32)
    variant = pipeline.variant(picture_size(options.data))
    side = pipeline.granularity
    if config.copies < 1 or any(stage.crop and stage.crop % side for stage in config.stages):
        raise TrainingError(f"{options.config}: copies must be at least 1, and crop a multiple of {side} pixels")
    encoded = Encoded(options.cache or options.out / "cache", pipeline, config.copies)
    encoded.prepare(options.data, pipeline)
    network = trainable(changed(pipeline.load(variant), config.network, options.from_scratch)).to(device)
    config.train(network)
    del pipeline  # and with it the image encoder
    state = TrainingState(network, config.learning_rate, config.weight_decay, config.average_decay)
    perceptual = perceptual_term(device, "vgg")  # as the authors
    if ranks.is_first():
        others = {*TRANSFORMERS} - {variant} if options.from_scratch else ()
        copy_bundle(options.start, bundle, f"{variant}/{WEIGHTS}", *others)
        if config.network:
            write_config(bundle / variant, network.config)

    def scenes(stage: Stage) -> Iterator[PublishedSample]:
        return stream(options.data, Drawn(encoded, stage, side, config.offset), stage,
                             (options.seed, state.step), 0.0, options.workers)

    run(state, config, options, iterate_stages(config, state, scenes),
        lambda sample: sample_loss(network, sample, perceptual),
        lambda: write_transformer(bundle / variant, network, state.average))


def changed(network: RenderFormer, settings: dict, from_scratch: bool) -> RenderFormer:
    """The network with other settings of its ModelConfig (ablations), and with new weights or its own.

    Raises TrainingError for settings that do not exist, or for which its weights are of the wrong size.
    """
    try:
        config = ModelConfig.from_dict(network.config.to_dict() | settings)
        if from_scratch:
            return new_transformer(config)
        with torch.device("meta"):
            other = new_network(config)
        other.load_state_dict(network.state_dict(), assign=True)
        return other
    except CheckpointError as error:
        raise TrainingError(f"network: {error}") from error
    except RuntimeError as error:
        raise TrainingError(f"the weights do not fit a network of {settings}: leave it out, or add --from-scratch"
                            ) from error


def write_config(folder: Path, config: ModelConfig) -> None:
    """Say what the published config.yaml beside it has no names for; it is read before that."""
    (folder / MODEL_CONFIG).write_text(json.dumps(FORMAT | {"model_config": config.to_dict()}, indent=1) + "\n")


def trainable(network: RenderFormer) -> RenderFormer:
    """The network with weights of its own (those that were read may be the file itself), ready for gradients."""
    for p in network.parameters():
        p.data = p.data.clone()
    return network.requires_grad_(True).train()


def copy_bundle(source: Path, target: Path, *but: str) -> None:
    """All of a bundle and its VAE but some files and folders; without taking space where the disk can."""
    files = {path.relative_to(source): path for path in source.rglob("*")}
    if not (source / "vae").is_dir():
        vae = find_vae(source)
        files |= {Path("vae") / path.relative_to(vae): path for path in vae.rglob("*")}
    for name, path in files.items():
        hidden = any(part.startswith(".") for part in name.parts)
        if hidden or {name.as_posix(), name.parts[0]} & set(but) or not path.is_file() or (target / name).exists():
            continue
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        try:
            os.link(path.resolve(), target / name)
        except OSError:  # another disk, or one that knows no links
            shutil.copyfile(path, target / name)


def write_transformer(folder: Path, network: RenderFormer, average: dict[str, torch.Tensor]) -> None:
    """Replace the folder's weights, float32 as they were trained, and never write into the old file."""
    state = {name: tensor.detach().cpu().contiguous() for name, tensor in (network.state_dict() | average).items()}
    partial = folder / f"{WEIGHTS}.part"
    save_file(state, partial)
    partial.replace(folder / WEIGHTS)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.train.published", description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder of samples")
    parser.add_argument("--start", type=Path, required=True, metavar="BUNDLE_DIR")
    parser.add_argument("--from-scratch", action="store_true",
                        help="only take the other files of BUNDLE_DIR, and new weights for the transformer")
    parser.add_argument("--cache", type=Path, help="prepared samples (default: OUT/cache)")
    add_arguments(parser, "published.json")
    return run_command(train, parser.parse_args())


if __name__ == "__main__":
    sys.exit(main())
