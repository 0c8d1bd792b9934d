# SPDX-License-Identifier: GPL-3.0-or-later
"""Training samples: the inputs that the renderer makes for one scene, and the expected output."""
from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from renderformer_v2.model.fields import COLOR, array
from renderformer_v2.model.guided.features import GuidedView, guided_view
from renderformer_v2.model.guided.guided_inputs import GuidedInputs, guided_inputs
from renderformer_v2.model.light.bounce.radiosity import Radiosity
from renderformer_v2.model.light.direct.direct_light import DirectLight
from renderformer_v2.model.light.estimate import SceneLight
from renderformer_v2.model.light.surface_light import SurfaceLight
from renderformer_v2.model.light_passes import LOBES
from renderformer_v2.model.network.inputs import EnvironmentInputs, VolumeInputs, material_tiles
from renderformer_v2.model.normalize import Normalization
from renderformer_v2.model.tensor_group import TensorGroup, stacked
from renderformer_v2.model.weights.presets import BUNDLED, PRESETS
from tools.datagen.sample_files import load_with_paths

from . import sample_cache
from .errors import SampleError

CONFIG = PRESETS[BUNDLED]()  # whose tile and panorama sizes the samples have


@dataclass
class TrainingSample(TensorGroup):
    """One scene with V views in network units; targets in the exposure of each view."""

    inputs: GuidedInputs  # `texture` (T, 11, t, t) is BSDF parameters until `with_latents` maps them
    view: GuidedView
    image: Tensor = array("V", 3, "H", "W", behaves={COLOR: 1})  # radiance without directly seen emitters and world
    direct: Tensor = array("V", 3, 3, "H", "W", behaves={COLOR: 2})  # light of white lobes
    indirect: Tensor = array("V", 3, 3, "H", "W", behaves={COLOR: 2})


def with_latents(sample: TrainingSample, mapper) -> TrainingSample:
    """The sample with its materials mapped to appearance latents."""
    return replace(sample, inputs=replace(sample.inputs, texture=material_tiles(sample.inputs.texture, mapper)))


def unreadable(path: Path, error: Exception) -> SampleError:
    return SampleError(f"{path} cannot be read ({error}): delete it, and tools.datagen makes it again")


def build_sample(path: Path, hinted: bool = True) -> TrainingSample:
    """From one file of tools.datagen, `hinted` with its traced light. Raises SampleError when it cannot be read."""
    try:
        scene, views, guides, passes = load_with_paths(path)
    except Exception as error:  # a damaged archive raises whatever the damage leads to
        raise unreadable(path, error) from error
    normalization = Normalization.of(scene)
    normalized = normalization.scene(scene)
    direct = DirectLight(normalized)
    light = SceneLight(normalized, direct, Radiosity(normalized, direct))
    inputs, targets = [], []
    for view, guide, reference in zip(views, guides, passes, strict=True):
        guide = guide if hinted else replace(guide, traced=None)
        inputs.append(guided_view(light, normalization.view(view), normalization.guides(guide), CONFIG))
        surface = reference["combined"][..., :3] - reference["emission"]
        targets.append([surface.clip(0), *(np.stack([reference[f"{lobe}_{part}"] for lobe in LOBES])
                                           for part in ("direct", "indirect"))])
    image, direct, indirect = (torch.from_numpy(np.stack(t).astype(np.float32) * np.float32(normalization.exposure))
                               .movedim(-1, -3) for t in zip(*targets, strict=True))
    view = stacked(inputs)
    targets = (t * view.exposure.view(-1, *[1] * (t.ndim - 1)) for t in (image, direct, indirect))
    return TrainingSample(guided_inputs(normalized, CONFIG), view, *targets)


def cached_sample(path: Path, cache: Path, hinted: bool = True) -> TrainingSample:
    """`build_sample`, kept in `cache` for the next epoch; made again when it is out of date."""
    stored = sample_cache.cache_path(path, cache, "" if hinted else "-alone")
    return sample_cache.load_or_make(stored, sample_cache.sample_key(path), lambda: build_sample(path, hinted), KINDS)


KINDS = {"": TrainingSample, "inputs": GuidedInputs, "view": GuidedView, "light": SurfaceLight,
         "environment": EnvironmentInputs, "volumes": VolumeInputs}
