# SPDX-License-Identifier: GPL-3.0-or-later
"""Trains the 9-D appearance latent: the mappers from BSDF parameters to it, and the autoencoder of sphere pictures.

    python -m tools.train.material SPHERES_DIR --work WORK_DIR -o model/weights/material

SPHERES_DIR comes from `python -m tools.datagen.spheres`. Loss as in docs/scene-input.md 3.6: L1 in log10(1 + radiance)
space plus a smoothness term. The published autoencoder came first and its mappers after it (how is unknown). With
thousands of spheres in place of 220,000 that order gives grey pictures, because colour is the last thing an encoder
learns. Here the mapper for glass, whose materials are the most diverse, and the decoder come first; the encoder learns
to find the same latents in the pictures, and the other mappers to find latents that the decoder shows as their spheres.
Continues from WORK_DIR when run again.
"""
from __future__ import annotations

import argparse
import json
import math
import sys
import time
from pathlib import Path

import torch
from safetensors.torch import save_file
from torch import Tensor, nn

from renderformer_v2.model.material.autoencoder import MaterialAutoencoder
from renderformer_v2.model.material.mappers import MAPPERS, Mapper
from renderformer_v2.model.weights.checkpoint import load_component

from . import ranks
from .run import report_errors, resume
from .spheres import HELD_OUT, load_spheres
from .state import TrainingState

AUTOENCODER = {"image_size": 64, "widths": (32, 64, 128), "residual_blocks": 1, "groups": 8}
FIRST = "metallic_transmission_mapper"
SMALL = {"hidden_dim": 128, "num_layers": 3}
SIZES = {"diffspec_mapper": SMALL, "metallic_mapper": SMALL, FIRST: {"hidden_dim": 256, "num_layers": 5}}
SMOOTHNESS_WEIGHT, SMOOTHNESS_SIGMA = 2.0, 2 / 255
LINEAR_WEIGHT = 0.05
RISING = 0.2  # of the steps, in which the learning rate rises


class MapperAndDecoder(nn.Module):
    """Parameters -> latent -> picture; a linear head must tell a 4x4 picture from the latent alone.

    The head is there in training only: it brings the colour into the latent from the first step on.
    """

    def __init__(self, mapper: nn.Module, model: MaterialAutoencoder):
        super().__init__()
        self.mapper, self.model, self.head = mapper, model, nn.Linear(9, 48)


def new_mapper(name: str) -> Mapper:
    mapper = MAPPERS[name](**SIZES[name])
    for layer in mapper.layers:  # PyTorch's default lets five layers shrink the input to nothing
        nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
        nn.init.zeros_(layer.bias)
    return mapper


def fit(model: nn.Module, loss_of_batch, count: int, path: Path, *, steps: int, batch: int, rate: float) -> None:
    """AdamW with a one-cycle learning rate over `count` samples; `loss_of_batch(indices)` gives the loss.

    Each process takes its share of the `batch`.
    """
    ranks.share(batch, "spheres of a step")
    state = TrainingState(model, rate, weight_decay=0.01, average_decay=0.0)
    resume(state, path)
    loss_of_batch = ranks.with_shared_gradients(model, loss_of_batch)
    average, start = None, time.time()
    while state.step < steps:
        indices = torch.randint(count, (batch,), generator=torch.Generator().manual_seed(state.step + state.skipped))
        loss = loss_of_batch(indices[ranks.rank()::ranks.count()])
        loss.backward()
        if not state.advance(rate * one_cycle(state.step / steps), clip_norm=1.0):
            continue
        average = loss.item() if average is None else 0.98 * average + 0.02 * loss.item()
        if ranks.is_first() and (state.step % 100 == 0 or state.step == steps):
            print(f"{path.stem} {state.step}/{steps}: loss {average:.5f}, {time.time() - start:.0f} s", flush=True)
            state.save(path)


def one_cycle(done: float) -> float:
    """Share of the peak learning rate: half a cosine up, half a cosine down to zero."""
    phase = done / RISING if done < RISING else 1 + (done - RISING) / (1 - RISING)
    return (1 - math.cos(math.pi * phase)) / 2


def train_mapper(mapper: nn.Module, model: MaterialAutoencoder, parameters: Tensor, images: Tensor, work: Path,
                 steps: int) -> None:
    """Mapper and decoder together, as a renderer of spheres."""
    both = MapperAndDecoder(mapper, model)
    coarse = nn.functional.avg_pool2d(images, images.shape[-1] // 4).flatten(1)
    coarse = (coarse - coarse.mean(0)) / coarse.std(0).mean()

    def loss_of_batch(indices: Tensor) -> Tensor:
        latent = mapper(parameters[indices])
        some = latent[: len(latent) // 4]  # the smoothness term needs fewer samples than the pictures do
        moved = (some + SMOOTHNESS_SIGMA * torch.randn_like(some)).clamp(-1, 1)
        decoded, nearby = model.decode(torch.cat([latent, moved])).split([len(latent), len(some)])
        return ((decoded - images[indices]).abs().mean()
                + SMOOTHNESS_WEIGHT * (decoded[: len(some)] - nearby).abs().mean()
                + LINEAR_WEIGHT * (both.head(latent) - coarse[indices]).abs().mean())

    fit(both, loss_of_batch, len(images), work / "mapper.safetensors", steps=steps, batch=32, rate=2e-3)


def train_encoder(mapper: nn.Module, model: MaterialAutoencoder, parameters: Tensor, images: Tensor, work: Path,
                  steps: int) -> None:
    """The encoder alone: it finds the mapper's latents in the pictures."""
    decoder = [p for name, p in model.named_parameters() if name.startswith("decoder")]
    for p in decoder:
        p.requires_grad_(False)
    with torch.no_grad():
        latents = mapper(parameters)

    def loss_of_batch(indices: Tensor) -> Tensor:
        latent = model.encode(images[indices])
        return ((model.decode(latent) - images[indices]).abs().mean()
                + 0.1 * (latent - latents[indices]).abs().mean())

    fit(model, loss_of_batch, len(images), work / "autoencoder.safetensors", steps=steps, batch=32, rate=1e-3)


def train_other(name: str, mapper: Mapper, model: MaterialAutoencoder, parameters: Tensor, images: Tensor,
                work: Path, steps: int) -> None:
    """A mapper alone: the decoder shows what it finds as the spheres, and the encoder finds about the same in them."""
    model.requires_grad_(False)
    latents = encode(model, images)

    def loss_of_batch(indices: Tensor) -> Tensor:
        latent = mapper(parameters[indices])
        return ((model.decode(latent) - images[indices]).abs().mean()
                + 0.1 * (latent - latents[indices]).abs().mean())

    fit(mapper, loss_of_batch, len(images), work / f"{name}.safetensors", steps=steps, batch=32, rate=3e-3)


@torch.no_grad()
def encode(model: MaterialAutoencoder, images: Tensor) -> Tensor:
    return torch.cat([model.encode(part) for part in images.split(64)])


@torch.no_grad()
def held_out_errors(mapper: nn.Module, model: MaterialAutoencoder, parameters: Tensor,
                    images: Tensor) -> dict[str, float]:
    """Mean absolute errors on spheres that training has not seen, in log10(1 + radiance) space; hue is what colour adds
    to grey, and mean_picture the error of always showing the average sphere."""
    latents, mapped = encode(model, images), mapper(parameters)
    hue = lambda x: x - x.mean(1, keepdim=True)  # noqa: E731
    pictures = {"autoencoder": model.decode(latents), "mapper": model.decode(mapped),
                "mean_picture": images.mean(0)[None]}
    errors = {f"{name}_l1": (x - images).abs().mean().item() for name, x in pictures.items()}
    errors |= {f"{name}_hue_l1": (hue(x) - hue(images)).abs().mean().item() for name, x in pictures.items()}
    return errors | {"latent_l1": (mapped - latents).abs().mean().item()}


def save(module: nn.Module, folder: Path, config: dict) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    weights = {key: value.half().contiguous() for key, value in module.state_dict().items()}
    save_file(weights, folder / "model.safetensors")
    (folder / "config.json").write_text(json.dumps(config, indent=1) + "\n")


def train(args: argparse.Namespace) -> None:
    """Raises TrainingError when there is too little to train with, or when training has gone wrong."""
    wanted = [name for name in MAPPERS if name != FIRST]
    spheres = {name: load_spheres(args.spheres / name) for name in ([] if args.autoencoder else [FIRST]) + wanted}
    args.work.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(0)
    if args.autoencoder:
        model = load_component(MaterialAutoencoder, args.autoencoder / "material_autoencoder")
    else:
        model, mapper = MaterialAutoencoder(**AUTOENCODER), new_mapper(FIRST)
        training = [tensor[HELD_OUT:] for tensor in spheres[FIRST]]
        train_mapper(mapper, model, *training, args.work, args.mapper_steps)
        train_encoder(mapper, model, *training, args.work, args.encoder_steps)
        if ranks.is_first():
            save(model, args.out / "material_autoencoder", AUTOENCODER)
        finish(FIRST, mapper, model, spheres, args.out)
    for name in wanted:
        mapper = new_mapper(name)
        train_other(name, mapper, model, *(tensor[HELD_OUT:] for tensor in spheres[name]), args.work, args.other_steps)
        finish(name, mapper, model, spheres, args.out)


def finish(name: str, mapper: Mapper, model: MaterialAutoencoder, spheres: dict[str, tuple[Tensor, Tensor]],
           out: Path) -> None:
    """Save a mapper and print how well it does on spheres that training has not seen."""
    if ranks.is_first():
        print(name, json.dumps(held_out_errors(mapper, model, *(tensor[:HELD_OUT] for tensor in spheres[name]))))
        save(mapper, out / name, SIZES[name])


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.train.material", description=__doc__.splitlines()[0])
    parser.add_argument("spheres", type=Path)
    parser.add_argument("--work", type=Path, required=True, help="folder for the state of a run")
    parser.add_argument("-o", "--out", type=Path, default=Path("model/weights/material"))
    parser.add_argument("--mapper-steps", type=int, default=2000, help=f"of {FIRST} and decoder")
    parser.add_argument("--encoder-steps", type=int, default=500)
    parser.add_argument("--other-steps", type=int, default=600, help="of each of the other mappers")
    parser.add_argument("--autoencoder", type=Path, metavar="DIR",
                        help=f"train only the other mappers, for the material_autoencoder in DIR and its {FIRST}")
    args = parser.parse_args()
    args.device = "cpu"
    with ranks.join(args):
        return report_errors(lambda: train(args))


if __name__ == "__main__":
    sys.exit(main())
