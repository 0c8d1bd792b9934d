# SPDX-License-Identifier: GPL-3.0-or-later
"""Trains the 9-D appearance latent: the mapper from BSDF parameters to it, and the autoencoder of sphere pictures.

    python -m tools.train.material SPHERES_DIR --work WORK_DIR -o model/weights/material

SPHERES_DIR comes from `python -m tools.datagen.spheres`. Loss as in docs/scene-input.md 3.6: L1 in log10(1 + radiance)
space plus a smoothness term. The published autoencoder came first and its mappers after it (how is unknown). With
thousands of spheres in place of 220,000 that order gives grey pictures, because colour is the last thing an encoder
learns. Here mapper and decoder come first, and the encoder learns to find the same latents in the pictures. Continues
from WORK_DIR when run again.
"""
from __future__ import annotations

import argparse
import json
import math
import sys
import time
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import save_file
from torch import Tensor, nn

from renderformer_v2.model.material.autoencoder import MaterialAutoencoder
from renderformer_v2.model.material.mappers import MetallicTransmissionMapper

from . import ranks
from .errors import TrainingError
from .run import report_errors, resume
from .state import TrainingState

AUTOENCODER = {"image_size": 64, "widths": (32, 64, 128), "residual_blocks": 1, "groups": 8}
MAPPER = {"hidden_dim": 256, "num_layers": 5}
SMOOTHNESS_WEIGHT, SMOOTHNESS_SIGMA = 2.0, 2 / 255
LINEAR_WEIGHT = 0.05
HELD_OUT = 200


class MapperAndDecoder(nn.Module):
    """Parameters -> latent -> picture; a linear head must tell a 4x4 picture from the latent alone.

    The head is there in training only: it brings the colour into the latent from the first step on.
    """

    def __init__(self, mapper: nn.Module, model: MaterialAutoencoder):
        super().__init__()
        self.mapper, self.model, self.head = mapper, model, nn.Linear(9, 48)
        for layer in mapper.layers:  # PyTorch's default lets five layers shrink the input to nothing
            nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
            nn.init.zeros_(layer.bias)


def load_spheres(folder: Path) -> tuple[Tensor, Tensor]:
    """Parameters (n, 7) and pictures (n, 3, 64, 64) in log10(1 + radiance) space, clamped to the decoder's [0, 1].

    Raises TrainingError when the folder has no more spheres than are held out, or one of its files cannot be read.
    """
    remedy = f"make more with python -m tools.datagen.spheres {folder}"
    if not folder.is_dir():
        raise TrainingError(f"there is no folder {folder}: check SPHERES_DIR, or {remedy}")
    shards = [_load_shard(path) for path in sorted(folder.glob("spheres_*.npz"))]
    count = sum(len(images) for _, images in shards)
    if count <= HELD_OUT:
        raise TrainingError(f"{folder} holds {count} spheres (spheres_*.npz) and {HELD_OUT} are held out: {remedy}")
    parameters, images = (np.concatenate(arrays) for arrays in zip(*shards, strict=True))
    images = images.astype(np.float32)
    return torch.from_numpy(parameters), torch.from_numpy(np.log10(1 + images)).clamp(0, 1).permute(0, 3, 1, 2)


def _load_shard(path: Path) -> tuple[np.ndarray, np.ndarray]:
    try:
        with np.load(path) as shard:
            return shard["parameters"], shard["images"]
    except Exception as error:  # a damaged archive raises whatever the damage leads to
        raise TrainingError(f"{path} cannot be read ({error}): delete it, and tools.datagen.spheres makes it "
                            "again") from error


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


def one_cycle(done: float, rising: float = 0.2) -> float:
    """Share of the peak learning rate: half a cosine up, half a cosine down to zero."""
    phase = done / rising if done < rising else 1 + (done - rising) / (1 - rising)
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
    parameters, images = load_spheres(args.spheres)
    args.work.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(0)
    model, mapper = MaterialAutoencoder(**AUTOENCODER), MetallicTransmissionMapper(**MAPPER)
    train_mapper(mapper, model, parameters[HELD_OUT:], images[HELD_OUT:], args.work, args.mapper_steps)
    train_encoder(mapper, model, parameters[HELD_OUT:], images[HELD_OUT:], args.work, args.encoder_steps)
    if not ranks.is_first():
        return
    print(json.dumps(held_out_errors(mapper, model, parameters[:HELD_OUT], images[:HELD_OUT])))
    save(mapper, args.out / "metallic_transmission_mapper", MAPPER)
    save(model, args.out / "material_autoencoder", AUTOENCODER)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.train.material", description=__doc__.splitlines()[0])
    parser.add_argument("spheres", type=Path)
    parser.add_argument("--work", type=Path, required=True, help="folder for the state of a run")
    parser.add_argument("-o", "--out", type=Path, default=Path("model/weights/material"))
    parser.add_argument("--mapper-steps", type=int, default=2000, help="of mapper and decoder")
    parser.add_argument("--encoder-steps", type=int, default=500)
    args = parser.parse_args()
    args.device = "cpu"
    with ranks.join(args):
        return report_errors(lambda: train(args))


if __name__ == "__main__":
    sys.exit(main())
