# SPDX-License-Identifier: GPL-3.0-or-later
"""Training samples for a published bundle: the inputs that its pipeline makes, and the expected output."""
from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from renderformer_v2.model.camera import place_in
from renderformer_v2.model.network.inputs import NetworkInputs, TensorGroup, ViewInputs, stacked
from renderformer_v2.model.normalize import Normalization
from renderformer_v2.model.published.as_trained import as_trained, emitters
from renderformer_v2.model.published.pipeline import PublishedPipeline, shown
from renderformer_v2.model.renderer import padded
from renderformer_v2.model.scene import Guides, View
from renderformer_v2.model.tensors import view_inputs
from tools.datagen.shards import load_sample, sample_paths

from . import ranks
from .errors import SampleError, TrainingError


@dataclass
class PublishedSample(TensorGroup):
    """One scene with V views in network units and exposure, its latents computed; H, W: what the network renders."""

    inputs: NetworkInputs
    rays: ViewInputs
    image: torch.Tensor  # (V, 3, H, W) f32 radiance, zero where nothing is compared
    shown: torch.Tensor  # (V, 1, H, W) bool, what is compared


def picture_size(folder: Path) -> int:
    """Pixels of the longer side, the same for all samples of a folder that there can be. Raises TrainingError."""
    for path in sample_paths(folder):
        with np.load(path) as file:
            return int(max(file["view.width"].max(), file["view.height"].max()))
    raise TrainingError(f"{folder} holds no samples (scene_*.npz): "
                        f"make some with python -m tools.datagen {folder} --blend FILE.blend")


def load_samples(folder: Path, pipeline: PublishedPipeline) -> list[PublishedSample]:
    """All of a folder; every texture and environment is encoded once. Raises SampleError for a file of no use."""
    samples = []
    for path in sample_paths(folder):
        try:
            samples.append(build_sample(path, pipeline))
        except Exception as error:  # a damaged archive raises whatever the damage leads to
            raise SampleError(f"{path} cannot be used ({error}): delete it, and make it again") from error
        if ranks.first():
            print(f"{path.name}: {len(samples[-1].inputs.texture)} textures encoded", flush=True)
    return samples


def endless(samples: list, seed: tuple[int, int], place: int = 0, count: int = 1) -> Iterator:
    """Epoch after epoch in random order; of those, every count-th one from `place` on."""
    random = np.random.default_rng(seed)
    orders = (random.permutation(len(samples)) for _ in itertools.count())
    for i in itertools.islice(itertools.chain.from_iterable(orders), place, None, count):
        yield samples[i]


def build_sample(path: Path, pipeline: PublishedPipeline) -> PublishedSample:
    """From one file of tools.datagen, with the encoder that rendering uses."""
    scene, views, guides, passes = load_sample(path)
    normalization = Normalization.of(scene)
    normalized = normalization.scene(scene)
    emits = emitters(normalized)
    with torch.no_grad():
        inputs = pipeline.encoder.inputs(pipeline.encoder.process(as_trained(normalized, emits)))
    rays, pictures, masks = [], [], []
    for view, guide, reference in zip(views, guides, passes, strict=True):
        surface = (reference["combined"][..., :3] - reference["emission"]).clip(0) * np.float32(normalization.exposure)
        larger, picture, mask = compared(view, guide, surface, emits, pipeline.granularity)
        rays.append(view_inputs(normalization.view(larger)))
        pictures.append(picture)
        masks.append(mask)
    return PublishedSample(inputs, stacked(rays), torch.from_numpy(np.stack(pictures)).movedim(-1, 1).contiguous(),
                           torch.from_numpy(np.stack(masks))[:, None])


def compared(view: View, guides: Guides, picture: np.ndarray, emitters: np.ndarray,
             granularity: int) -> tuple[View, np.ndarray, np.ndarray]:
    """The view that the network renders, its picture (H, W, 3) f32, and where that is known (H, W)."""
    larger, _ = padded(view, guides, granularity)
    place, mask = place_in(larger, view), shown(guides, emitters)
    wide = np.zeros((larger.height, larger.width, 3), np.float32)
    known = np.zeros(wide.shape[:2], bool)
    wide[place], known[place] = picture * mask[..., None], mask
    return larger, wide, known
