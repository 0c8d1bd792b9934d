# SPDX-License-Identifier: GPL-3.0-or-later
"""Training samples for a published bundle: the inputs that its pipeline makes, and the expected output."""
from __future__ import annotations

import zipfile
import zlib
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import torch

from renderformer_v2.model.camera import find_window
from renderformer_v2.model.fields import COLOR, PANORAMA, array, map_arrays
from renderformer_v2.model.network.inputs import (
    EnvironmentInputs,
    NetworkInputs,
    TensorGroup,
    ViewInputs,
    VolumeInputs,
    view_inputs,
)
from renderformer_v2.model.normalize import Normalization
from renderformer_v2.model.published.as_trained import as_trained, find_emitters
from renderformer_v2.model.published.pipeline import PublishedPipeline, displayed_pixels
from renderformer_v2.model.renderer import padded
from renderformer_v2.model.scene import Guides, RenderScene, View
from renderformer_v2.model.tensor_group import stacked
from tools.datagen.sample_files import load_sample, sample_paths

from . import ranks, sample_cache
from .augment import for_numpy, recolored, resampled, rotation, turned
from .errors import SampleError, TrainingError
from .samples import seed_of, unreadable

DAMAGED = (OSError, ValueError, KeyError, EOFError, TypeError, zipfile.BadZipFile, zlib.error)  # what such files raise


@dataclass
class PublishedSample(TensorGroup):
    """One scene with V views in network units and exposure, its latents computed; H, W: what the network renders."""

    inputs: NetworkInputs
    rays: ViewInputs
    image: torch.Tensor = array("V", 3, "H", "W", behaves={COLOR: 1})  # radiance, zero where nothing is compared
    mask: torch.Tensor = array("V", 1, "H", "W")                       # bool, what is compared


@dataclass
class Copy(TensorGroup):
    """The scene of a sample turned and recoloured, encoded anew; its views and pictures are the sample's."""

    inputs: NetworkInputs
    turn: torch.Tensor = array(3, 3)  # float32, rotation about the centre of the world
    order: torch.Tensor = array(3)    # int64, of the colour channels

    def of(self, sample: PublishedSample) -> PublishedSample:
        """The sample in this world."""
        changes = turned(self.turn) | {COLOR: recolored(self.order)}
        return replace(map_arrays(replace(sample, inputs=None), changes), inputs=self.inputs)


KINDS = {"": PublishedSample, "inputs": NetworkInputs, "rays": ViewInputs, "environment": EnvironmentInputs,
         "volumes": VolumeInputs}
COPY_KINDS = KINDS | {"": Copy}


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
    """Samples whose latents a pipeline's encoder has made, kept in `cache`, so many `copies` of each.

    The first is the sample itself. The others store their scene alone, so that large pictures are there once.
    """

    def __init__(self, cache: Path, pipeline: PublishedPipeline, copies: int = 1):
        self.cache, self.by, self.copies = cache, pipeline.encoder.images.identity.hex(), copies

    def prepare(self, folder: Path, pipeline: PublishedPipeline) -> None:
        """Make what is missing, each process its share, for all. A file of no use is named and left out."""
        for path in sample_paths(folder)[ranks.rank()::ranks.count()]:
            try:
                for copy in range(self.copies):
                    make = partial(build_copy, copy=copy) if copy else build_sample
                    sample_cache.make_if_missing(self._stored_path(path, copy), self._key(path),
                                                 partial(make, path, pipeline))
            except DAMAGED as error:
                print(f"{unreadable(path, error)} (left out)", flush=True)
                continue
            print(f"{path.name}: encoded", flush=True)
        ranks.wait_for_all()

    def __call__(self, path: Path, generator: torch.Generator) -> PublishedSample:
        """One of its copies. Raises SampleError for a sample that was not prepared."""
        def missing():
            raise SampleError(f"{path} is not prepared: it is newer than this run, or cannot be read")

        def load(copy: int, kinds: dict[str, type]):
            return sample_cache.load_or_make(self._stored_path(path, copy), self._key(path), missing, kinds)

        copy, sample = int(torch.randint(self.copies, (), generator=generator)), load(0, KINDS)
        return load(copy, COPY_KINDS).of(sample) if copy else sample

    def _stored_path(self, path: Path, copy: int) -> Path:
        return sample_cache.cache_path(path, self.cache, f"-{copy}" if copy else "")

    def _key(self, path: Path) -> str:
        return f"{sample_cache.sample_key(path, sample_cache.PUBLISHED)}-{self.by}"


def build_sample(path: Path, pipeline: PublishedPipeline) -> PublishedSample:
    """The sample of one file of tools.datagen, with the encoder that rendering uses."""
    scene, views, guides, passes = load_sample(path)
    normalization = Normalization.of(scene)
    normalized = normalization.scene(scene)
    emits = find_emitters(normalized)
    rays, pictures, masks = [], [], []
    for view, guide, reference in zip(views, guides, passes, strict=True):
        surface = (reference["combined"][..., :3] - reference["emission"]).clip(0) * np.float32(normalization.exposure)
        larger, picture, mask = compared(view, guide, surface, emits, pipeline.granularity)
        rays.append(view_inputs(normalization.view(larger)))
        pictures.append(picture)
        masks.append(mask)
    image = torch.from_numpy(np.stack(pictures)).movedim(-1, 1).contiguous()
    return PublishedSample(encode(as_trained(normalized, emits), pipeline), stacked(rays), image,
                           torch.from_numpy(np.stack(masks))[:, None])


def build_copy(path: Path, pipeline: PublishedPipeline, copy: int) -> Copy:
    """A copy of the sample of one file, always the same one for the same number."""
    scene = load_sample(path).scene
    normalized = Normalization.of(scene).scene(scene)
    emits = find_emitters(normalized)
    turn, order = symmetry_of(path, copy, recolors=scene.latents is None)
    changes = turned(turn) | {COLOR: recolored(order), PANORAMA: resampled(turn)}
    return Copy(encode(as_trained(map_arrays(normalized, for_numpy(changes)), emits), pipeline), turn, order)


def encode(scene: RenderScene, pipeline: PublishedPipeline) -> NetworkInputs:
    """The inputs of a scene as it was trained."""
    with torch.no_grad():
        return pipeline.encoder.inputs(pipeline.encoder.process(scene))


def symmetry_of(path: Path, copy: int, recolors: bool) -> tuple[torch.Tensor, torch.Tensor]:
    """A rotation (3, 3) about any axis (docs/scene-input.md 1.1), and an order of the colour channels.

    recolors: False where the appearance of some materials is known in one order alone.
    """
    draw = seed_of(path, copy)
    turn = rotation(torch.from_numpy(draw.normal(size=3)))
    return turn, torch.from_numpy(draw.permutation(3) if recolors else np.arange(3))


def compared(view: View, guides: Guides, picture: np.ndarray, emitters: np.ndarray,
             granularity: int) -> tuple[View, np.ndarray, np.ndarray]:
    """The view that the network renders, its picture (H, W, 3) f32, and where that is known (H, W)."""
    larger, _ = padded(view, guides, granularity)
    place, mask = find_window(larger, view), displayed_pixels(guides, emitters)
    wide = np.zeros((larger.height, larger.width, 3), np.float32)
    known = np.zeros(wide.shape[:2], bool)
    wide[place], known[place] = picture * mask[..., None], mask
    return larger, wide, known
