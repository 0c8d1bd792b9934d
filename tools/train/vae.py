# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m tools.train.vae SAMPLES_DIR --bundle BUNDLE_DIR --work WORK_DIR: a small VAE for tiles and panoramas.

Of the published bundle's class, for a bundle of one's own whose mappers are there already. It learns to draw again the
tiles and panoramas of samples, and images of one colour; and a linear layer must tell the colours from the latents,
without which these soon know no more than dark and bright. Continues from WORK_DIR when run again.
"""
from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from renderformer_v2.model.environment import environment_images
from renderformer_v2.model.network.inputs import material_tiles
from renderformer_v2.model.published.bundle import Bundle
from renderformer_v2.model.published.image_encoder import vae_class
from renderformer_v2.model.published.scene_encoder import image_groups
from renderformer_v2.model.scene import TILE_SIZE
from tools.common.console import whole_number
from tools.datagen.sample_files import load_sample, sample_paths

from . import ranks
from .errors import TrainingError
from .material import fit
from .run import report_errors

SIZE = {"base_dim": 8, "dim_mult": [1, 2, 2, 2], "num_res_blocks": 1}
LATENT_WEIGHT = 1e-3  # of the latents' square: they stay about as large as 1
BATCH, RATE = 8, 2e-3
MOST_SAMPLES = 64
TILES, CROPS = 16, 8  # of each of them, and of each panorama


def load_images(folder: Path, bundle: Bundle) -> Tensor:
    """(n, 3, 32, 32) what the encoder is given of the samples of a folder, once each. Raises TrainingError."""
    mapper = bundle.mapper("metallic_transmission_mapper")
    rng, images = np.random.default_rng(0), []
    for path in sample_paths(folder)[:MOST_SAMPLES]:
        scene = load_sample(path).scene
        some = rng.permutation(len(scene.tiles))[:TILES]
        with torch.no_grad():
            raw = material_tiles(torch.from_numpy(scene.tiles[some]).float(), mapper)
        raw = torch.cat([raw[:, :12], torch.zeros_like(raw[:, :3]), raw[:, 12:]], 1)
        images += [image_groups(raw).flatten(0, 1)]
        if scene.environment is not None:
            images += [crop(image, rng) for image in environment_images(scene.environment)[:2] for _ in range(CROPS)]
    if not images:
        raise TrainingError(f"{folder} holds no samples (scene_*.npz): make some with python -m tools.datagen {folder}")
    return torch.cat(images).unique(dim=0)


def crop(image: np.ndarray, rng: np.random.Generator) -> Tensor:
    """(1, 3, 32, 32) of a panorama (3, H, W)."""
    y, x = (int(rng.integers(side - TILE_SIZE + 1)) for side in image.shape[1:])
    return torch.from_numpy(image[None, :, y:y + TILE_SIZE, x:x + TILE_SIZE].copy())


def train(options: argparse.Namespace) -> None:
    """Raises TrainingError when there are no samples, CheckpointError for a bundle without mappers."""
    images = load_images(options.samples, Bundle(options.bundle))
    print(f"{len(images)} different images", flush=True)
    torch.manual_seed(0)
    options.work.mkdir(parents=True, exist_ok=True)
    vae = vae_class()(**SIZE)
    both = nn.ModuleDict({"vae": vae, "colors": nn.Conv2d(vae.config.z_dim, 3, 1)})

    def loss_of_batch(indices: Tensor) -> Tensor:
        flat = torch.rand(len(indices), 3, 1, 1) * 2 - 1
        batch = torch.cat([images[indices], flat.expand(-1, -1, TILE_SIZE, TILE_SIZE)])[:, :, None]
        latents = vae.encode(batch).latent_dist.mean
        colors = nn.functional.interpolate(batch[:, :, 0], latents.shape[-2:], mode="area")
        return ((vae.decode(latents).sample - batch).abs().mean() + LATENT_WEIGHT * latents.square().mean()
                + (both["colors"](latents[:, :, 0]) - colors).abs().mean())

    fit(both, loss_of_batch, len(images), options.work / "vae.safetensors", steps=options.steps, batch=BATCH // 2,
        rate=RATE)
    if ranks.is_first():
        vae.half().save_pretrained(options.bundle / "vae")


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.train.vae", description=__doc__)
    parser.add_argument("samples", type=Path, metavar="SAMPLES_DIR")
    parser.add_argument("--bundle", type=Path, required=True, help="has the mappers, and gets the VAE")
    parser.add_argument("--work", type=Path, required=True, help="folder for the state of a run")
    parser.add_argument("--steps", type=whole_number(1), default=400)
    options = parser.parse_args()
    options.device = "cpu"
    with ranks.join(options):
        return report_errors(lambda: train(options))


if __name__ == "__main__":
    sys.exit(main())
