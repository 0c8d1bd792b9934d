# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings of a frame as they are read from a scene, and what follows from them."""
from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto
from pathlib import Path

import bpy

from ..model.errors import CheckpointError
from ..model.published.bundle_files import is_bundle
from ..model.weights.presets import weights_folder
from . import passes
from .convert.data.copied import ConversionOptions
from .reference_settings import FrameReference
from .render_size import frame_size
from .sampling import Sampling, automatic_samples
from .setup import packages


class Light(Enum):
    """What Cycles computes besides first hits."""

    NONE = auto()
    TRACED = auto()  # no diffuse and no volume bounce, denoised
    ALL = auto()     # the scene's own bounces


class Network(Enum):
    """The two kinds of networks, and what a render does for each."""

    GUIDED = auto()     # the bundled one, and others of this project's format: first hits and estimated light go in
    PUBLISHED = auto()  # the paper's: the scene alone goes in

    @property
    def has_lobes(self) -> bool:
        """Whether it gives the light of each lobe, for light passes and smooth edges."""
        return self is Network.GUIDED

    @property
    def encodes_textures(self) -> bool:
        """Whether an image encoder runs over the textures of all triangles before stage 1."""
        return self is Network.PUBLISHED

    @property
    def depends_on_size(self) -> bool:
        """Whether the size of the whole picture decides which of its transformers renders it."""
        return self is Network.PUBLISHED


@dataclass(frozen=True)
class FrameSettings:
    """What was chosen for one frame, keyframes included; it outlives the evaluated scene that it was read from."""

    weights: str
    network: Network
    transformer: str  # of published weights: one of bundle_files.TRANSFORMERS, or AUTOMATIC
    device: str
    precision: str
    token_budget: int
    max_edge: float
    as_is: bool
    paper_lamps: bool
    sampling: Sampling
    bake_unknown: bool
    light: Light
    rays: bool  # whether light is estimated by rays before the network sees it
    light_passes: frozenset[str]  # keys of those that the weights can give
    threads: int  # 0: all
    film_transparent: bool
    exposure: float
    reference: FrameReference | None

    @property
    def conversion(self) -> ConversionOptions:
        return ConversionOptions(self.token_budget, self.max_edge, self.as_is, self.paper_lamps,
                                 self.network is Network.PUBLISHED)

    @property
    def follows_specular_paths(self) -> bool:
        """Whether the network reads what mirrors and glass show."""
        return self.network is Network.GUIDED and self.rays

    @property
    def has_tokens(self) -> bool:
        """Whether the network reads the scene's triangles as tokens; where rays meet them, it does without."""
        return not self.follows_specular_paths

    @property
    def renderer(self) -> tuple:
        """What model_cache.renderer takes."""
        return self.weights, self.device, self.precision, self.transformer, self.rays

    @property
    def setup(self) -> str:
        """What the costs of a render belong to (costs.py)."""
        return " ".join([Path(self.weights).name, self.device, self.precision, f"{self.threads or 'all'} threads",
                         self.light.name.lower() if self.rays else "no rays"])

    @classmethod
    def read(cls, scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer | None = None) -> FrameSettings:
        """Read from an evaluated scene and the view layer that is rendered, which may have its own samples.

        Raises SceneError when the Cycles add-on is switched off, CheckpointError as `weights` of settings.py does.
        """
        packages.require_cycles()
        ours = scene.renderformer_v2
        weights = ours.weights()
        network = _network(weights)
        return cls(
            weights=weights, network=network, transformer=ours.transformer, device=ours.chosen_device(),
            precision=ours.precision, token_budget=ours.token_budget, max_edge=ours.max_edge, as_is=ours.as_is,
            paper_lamps=ours.paper_lamps and network is Network.PUBLISHED, sampling=read_sampling(scene, view_layer),
            bake_unknown=ours.bake_unknown, light=_light(ours.light, network), rays=ours.light != "TRANSFORMER",
            light_passes=light_passes(scene), threads=threads(scene), film_transparent=scene.render.film_transparent,
            exposure=scene.cycles.film_exposure, reference=FrameReference.read(scene))


def read_sampling(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer | None) -> Sampling:
    """The view layer's own number of samples or the scene's, or what suits the size of the whole picture."""
    ours, of_layer = scene.renderformer_v2, view_layer.renderformer_v2.samples if view_layer else 0
    return Sampling(of_layer or ours.guide_samples or automatic_samples(*frame_size(scene.render)),
                    ours.adaptive_threshold if ours.use_adaptive_sampling else 0.0, ours.adaptive_min_samples)


def threads(scene: bpy.types.Scene) -> int:
    """How many threads render it, 0 for all: our own setting, else Blender's, or what `blender -t` says."""
    ours, blenders = scene.renderformer_v2, scene.render
    holder = ours if ours.threads_mode == "FIXED" else blenders
    return holder.threads if holder.threads_mode == "FIXED" else 0


def light_passes(scene: bpy.types.Scene) -> frozenset[str]:
    """Keys of the passes OF_LIGHT that the chosen weights can give; shadow catchers need traced light."""
    try:
        network = _network(scene.renderformer_v2.weights())
    except CheckpointError:
        return frozenset()  # published weights that are not complete, or none at all
    if not network.has_lobes:
        return frozenset()
    is_traced = scene.renderformer_v2.light == "TRACED"
    return passes.LIGHTING | {passes.SHADOW_CATCHER.key} if is_traced else passes.LIGHTING


def is_published(settings: bpy.types.PropertyGroup) -> bool:
    """Whether the published network is chosen, complete or not."""
    if settings.weights_source == "PUBLISHED":
        return True
    has_folder = settings.weights_source == "FOLDER" and bool(settings.weights_folder)
    return has_folder and _network(settings.weights()) is Network.PUBLISHED


def traces_light(settings: bpy.types.PropertyGroup) -> bool:
    """Whether Cycles traces direct light."""
    return settings.light == "TRACED" and not is_published(settings)


def _light(choice: str, network: Network) -> Light:
    """The published network draws its picture alone, whatever was chosen."""
    return Light.TRACED if choice == "TRACED" and network is Network.GUIDED else Light.NONE


def _network(weights: str) -> Network:
    try:
        return Network.PUBLISHED if is_bundle(weights_folder(weights)) else Network.GUIDED
    except OSError:
        return Network.GUIDED  # the loader will explain it
