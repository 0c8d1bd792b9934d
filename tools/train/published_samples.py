# SPDX-License-Identifier: GPL-3.0-or-later
"""Training samples for a published bundle: the inputs that its pipeline makes, and the expected output."""
from __future__ import annotations

import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from renderformer_v2.model.camera import place_in
from renderformer_v2.model.network.inputs import (
    EnvironmentInputs,
    NetworkInputs,
    TensorGroup,
    ViewInputs,
    VolumeInputs,
    view_inputs,
)
from renderformer_v2.model.normalize import Normalization
from renderformer_v2.model.published.as_trained import as_trained, emitters
from renderformer_v2.model.published.pipeline import PublishedPipeline, shown
from renderformer_v2.model.renderer import padded
from renderformer_v2.model.scene import Guides, View
from renderformer_v2.model.tensor_group import stacked
from tools.datagen.sample_files import load_sample, sample_paths

from . import ranks
from . import sample_cache as cache_key
from .errors import SampleError, TrainingError
from .sample_cache import keep, kept
from .samples import unreadable

DAMAGED = (OSError, ValueError, KeyError, EOFError, TypeError, zipfile.BadZipFile, zlib.error)  # what such files raise


@dataclass
class PublishedSample(TensorGroup):
    """One scene with V views in network units and exposure, its latents computed; H, W: what the network renders."""

    inputs: NetworkInputs
    rays: ViewInputs
    image: torch.Tensor  # (V, 3, H, W) f32 radiance, zero where nothing is compared
    shown: torch.Tensor  # (V, 1, H, W) bool, what is compared


KINDS = {"": PublishedSample, "inputs": NetworkInputs, "rays": ViewInputs, "environment": EnvironmentInputs,
         "volumes": VolumeInputs}


def picture_size(folder: Path) -> int:
    """Pixels of the longer side, the same for all samples of a folder that there can be. Raises TrainingError."""
    for path in sample_paths(folder):
        try:
            with np.load(path) as file:
                return int(max(file["view.width"].max(), file["view.height"].max()))
        except DAMAGED:
            continue
    raise TrainingError(f"{folder} holds no samples (scene_*.npz) that can be read: "
                        f"make some with python -m tools.datagen {folder} --blend FILE.blend")


class Encoded:
    """Samples whose latents a pipeline's encoder has made, kept in `cache`."""

    def __init__(self, cache: Path, pipeline: PublishedPipeline):
        self.cache, self.by = cache, pipeline.encoder.images.identity.hex()
        cache.mkdir(parents=True, exist_ok=True)

    def prepare(self, folder: Path, pipeline: PublishedPipeline) -> None:
        """Make what is missing, each process its share, for all. A file of no use is named and left out."""
        for path in sample_paths(folder)[ranks.rank()::ranks.count()]:
            try:
                keep(self._place(path), self._key(path), lambda path=path: build_sample(path, pipeline))
            except DAMAGED as error:
                print(f"{unreadable(path, error)} (left out)", flush=True)
                continue
            print(f"{path.name}: encoded", flush=True)
        ranks.wait()

    def __call__(self, path: Path, _: torch.Generator) -> PublishedSample:
        """Raises SampleError for a sample that was not prepared."""
        def missing():
            raise SampleError(f"{path} is not prepared: it is newer than this run, or cannot be read")

        return kept(self._place(path), self._key(path), missing, KINDS)

    def _place(self, path: Path) -> Path:
        return cache_key.stored_path(path, self.cache)

    def _key(self, path: Path) -> str:
        return f"{cache_key.key(path, cache_key.PUBLISHED)}-{self.by}"


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
