# SPDX-License-Identifier: GPL-3.0-or-later
"""Training samples: the inputs that the renderer makes for one scene, and the expected output."""
from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from renderformer_v2.model.fields import COLOR, array
from renderformer_v2.model.guided.features import GuidedView, guided_view
from renderformer_v2.model.guided.guided_inputs import GuidedInputs, guided_inputs
from renderformer_v2.model.light.bounce.radiosity import Radiosity
from renderformer_v2.model.light.direct.direct_light import DirectLight
from renderformer_v2.model.light.effort import FULL
from renderformer_v2.model.light.estimate import SceneLight
from renderformer_v2.model.light.surface_light import SurfaceLight
from renderformer_v2.model.light_passes import LOBES
from renderformer_v2.model.network.inputs import EnvironmentInputs, VolumeInputs, material_tiles
from renderformer_v2.model.normalize import Normalization
from renderformer_v2.model.tensor_group import TensorGroup, stacked
from renderformer_v2.model.weights.presets import BUNDLED, PRESETS
from tools.datagen.sample_files import load_sample, load_with_paths

from . import sample_cache
from .errors import SampleError

CONFIG = PRESETS[BUNDLED]()  # whose tile and panorama sizes the samples have


@dataclass
class TrainingSample(TensorGroup):
    """One scene with V views in network units; targets in the exposure of each view."""

    inputs: GuidedInputs  # `texture` (T, 11, t, t) is BSDF parameters until `with_latents` maps them
    view: GuidedView
    image: Tensor = array("V", 3, "H", "W", behaves={COLOR: 1})  # radiance without directly seen emitters and world
    finished: Tensor = array("V", 3, "H", "W", behaves={COLOR: 1})  # with them
    direct: Tensor = array("V", 3, 3, "H", "W", behaves={COLOR: 2})  # light of white lobes
    indirect: Tensor = array("V", 3, 3, "H", "W", behaves={COLOR: 2})


def with_latents(sample: TrainingSample, mapper) -> TrainingSample:
    """The sample with its materials mapped to appearance latents."""
    return replace(sample, inputs=replace(sample.inputs, texture=material_tiles(sample.inputs.texture, mapper)))


def unreadable(path: Path, error: Exception) -> SampleError:
    return SampleError(f"{path} cannot be read ({error}): delete it, and tools.datagen makes it again")


class LightInputs(StrEnum):
    """Which light of its scene a sample gives the network."""

    TRACED = "traced"    # traced light, and estimates by rays
    RAYS = "rays"        # estimates by rays
    SCENE = "scene"      # direct light without shadows, in closed form


def build_sample(path: Path, light_inputs: LightInputs = LightInputs.TRACED) -> TrainingSample:
    """The sample of a file of tools.datagen. Raises SampleError when it cannot be read or its size is of no use."""
    try:
        scene, views, guides, passes = load_sample(path) if light_inputs is LightInputs.SCENE else load_with_paths(path)
    except Exception as error:  # a damaged archive raises whatever the damage leads to
        raise unreadable(path, error) from error
    width, height = views[0].width, views[0].height
    if width % CONFIG.granularity or height % CONFIG.granularity:
        raise SampleError(f"{path} has pictures of {width} x {height} pixels, but the network trains on multiples of "
                          f"{CONFIG.granularity}: make others with tools.datagen --resolution {2 * CONFIG.granularity}")
    # Smaller pictures have more rays for each probe.
    effort = replace(FULL, most_more=2.0 ** seed_of(path, 1).integers(3))
    normalization = Normalization.of(scene)
    normalized = normalization.scene(scene)
    direct = DirectLight(normalized)
    light = SceneLight(normalized, direct, None if light_inputs is LightInputs.SCENE else Radiosity(normalized, direct))
    inputs, targets = [], []
    for view, guide, reference in zip(views, guides, passes, strict=True):
        guide = guide if light_inputs is LightInputs.TRACED else replace(guide, traced=None)
        inputs.append(guided_view(light, normalization.view(view), normalization.guides(guide), CONFIG, effort))
        surface = reference["combined"][..., :3] - reference["emission"]
        targets.append([surface.clip(0), reference["combined"][..., :3] + reference["environment"],
                        *(np.stack([reference[f"{lobe}_{part}"] for lobe in LOBES])
                          for part in ("direct", "indirect"))])
    targets = (torch.from_numpy(np.stack(t).astype(np.float32) * np.float32(normalization.exposure)).movedim(-1, -3)
               for t in zip(*targets, strict=True))
    view = stacked(inputs)
    targets = (t * view.exposure.view(-1, *[1] * (t.ndim - 1)) for t in targets)
    closed_form = direct if light_inputs is LightInputs.SCENE else None
    return TrainingSample(guided_inputs(normalized, CONFIG, direct=closed_form), view, *targets)


def seed_of(path: Path, *of: int) -> np.random.Generator:
    """The random numbers of a sample, or of a part `of` it, which are always the same."""
    return np.random.default_rng((zlib.crc32(path.stem.encode()), *of))


def cached_sample(path: Path, cache: Path, light_inputs: LightInputs = LightInputs.TRACED) -> TrainingSample:
    """`build_sample`, kept in `cache` for the next epoch; made again when it is out of date."""
    return sample_cache.load_or_make(*_stored(path, cache, light_inputs), KINDS)


def prepare_sample(path: Path, cache: Path, light_inputs: LightInputs) -> None:
    """Fill the cache as `cached_sample` does, without reading a sample that is there."""
    sample_cache.make_if_missing(*_stored(path, cache, light_inputs))


def _stored(path: Path, cache: Path, light_inputs: LightInputs) -> tuple[Path, str, Callable[[], TrainingSample]]:
    return (sample_cache.cache_path(path, cache, f"-{light_inputs}"), sample_cache.sample_key(path),
            lambda: build_sample(path, light_inputs))


KINDS = {"": TrainingSample, "inputs": GuidedInputs, "view": GuidedView, "light": SurfaceLight,
         "environment": EnvironmentInputs, "volumes": VolumeInputs}
