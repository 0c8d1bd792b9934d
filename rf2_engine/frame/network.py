# SPDX-License-Identifier: GPL-3.0-or-later
"""The network's part of a view layer: add light to Cycles' first hits, once or for every sample."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...model import progress
from ...model.light_groups import lit_by_negative
from ...model.light_passes import Lobes, MeanLobes
from ...model.scene import Guides, RenderScene, View
from ...model.weights.presets import BUNDLED
from ..convert.fitting.framing import Framing
from ..progress.stages import CONVERT, EDGES, ENCODE, GROUPS, LOAD, TEXTURES, VIEW
from ..runtime import model_cache
from . import shutter
from .first_hits import FirstHits, render_sample_hits
from .layer import Layer
from .light_groups import GroupEstimates
from .light_subset import LightSubset
from .optics import Optics
from .output import EMITTED


@dataclass
class Picture:
    """A view of a view layer as far as it is rendered."""

    combined: np.ndarray  # (H, W, 4)
    guides: Guides
    lobes: Lobes
    tokens: int = 0  # of the scene that was encoded last; 0 without a transformer

    @classmethod
    def of(cls, hits: FirstHits, lobes: Lobes, exposure: float, tokens: int) -> Picture:
        """The picture of first hits with that light."""
        return cls(hits.composite(lobes.radiance, exposure), *hits.without_catchers(lobes), tokens)

    @classmethod
    def without_light(cls, hits: FirstHits, exposure: float) -> Picture:
        """The picture before the network has added anything."""
        return cls.of(hits, Lobes(np.zeros((*hits.guides.alpha.shape, 3), np.float32)), exposure, 0)


class LayerNetwork:
    """The network of one view layer. model_cache keeps what outlives it."""

    def __init__(self, layer: Layer, scene: RenderScene, framing: Framing) -> None:
        """Weights other than the bundled ones are loaded now: wrong ones are found before Cycles works for nothing."""
        self._layer, self._scene, self._framing, self._renderer = layer, scene, framing, None
        self._groups: GroupEstimates | None = None
        self._negative: LightSubset | None = None
        self._has_content = bool(len(scene) or scene.volumes)
        if self._has_content and layer.settings.weights != BUNDLED:
            self.load()
        model_cache.begin_import()  # while Cycles works, which leaves Python alone

    @property
    def device(self) -> str:
        """The device that it works on, and the number format; "" until it is loaded."""
        return self._renderer.computed_on if self._renderer else ""

    def load(self) -> None:
        """Load the weights, if they are not loaded yet; to be called before it renders."""
        if self._renderer is None:
            settings = self._layer.settings
            with self._layer.plan.enter(LOAD):
                self._renderer = model_cache.renderer(*settings.renderer)
            self._report_remark()
            if unused := model_cache.explain_unused_card(self._renderer) if settings.device == "auto" else "":
                self._layer.report.approximated("Device", unused)

    def _report_remark(self) -> None:
        """Report what the renderer had to do without."""
        if self._renderer.remark:
            self._layer.report.approximated("Device", self._renderer.remark)

    def can_light(self, guides: Guides) -> bool:
        """Whether anything is visible that it could light."""
        return self._has_content and bool(guides.alpha.any() or guides.transmission_color.any())

    def render_sharp(self, name: str, view: View, hits: FirstHits) -> Picture:
        """The picture of the view of that name with a pinhole."""
        layer = self._layer
        layer.status.sample = name and f"View {name}"
        encoded = self._encode(view)
        lobes = self._light(encoded, view, hits.guides)
        picture = Picture.of(hits, lobes, layer.settings.exposure, encoded.tokens)
        if layer.settings.network.has_lobes and hits.shadows is None:
            picture = self._smooth_edges(encoded, picture, hits, view.wraps)
        layer.status.sample = ""
        return picture

    def render_blurred(self, hits: dict[str, FirstHits], optics: Optics,
                       show: Callable[[dict[str, Lobes]], None]) -> dict[str, Picture]:
        """The pictures of all views, with the network's light as the mean of the samples of the optics.

        Nothing is computed twice: without a change in the scene but for the camera it stays encoded, and where nothing
        changes at all the sample before counts again. `hits` are those of the blurred picture, as Cycles renders them;
        `show` is called with the light so far, for every session of Cycles puts something else on screen.
        """
        layer, means, encoded = self._layer, {name: MeanLobes() for name in hits}, None
        status = layer.status

        def light_so_far() -> dict[str, Lobes]:
            return {name: mean.mean(hits[name].guides) for name, mean in means.items()}
        with shutter.clock(layer.engine, layer.depsgraph) as move_to:
            for number, frame in enumerate(optics.frames(layer.depsgraph)):
                status.sample = f"Sample {number + 1} of {optics.samples}"
                progress.report()
                changed = move_to(frame)
                if "scene" in changed:
                    with layer.plan.enter(CONVERT):
                        self._scene, encoded = layer.convert_again(self._framing), None
                if number == 0 or changed or optics.lens_samples > 1:
                    sample_hits, lobes = render_sample_hits(layer, self._scene, optics, number), {}
                    for name, (view, guides) in sample_hits.items():
                        encoded = encoded or self._encode(view)
                        lobes[name] = self._light(encoded, view, guides)
                for name, mean in means.items():
                    mean.add(lobes[name], sample_hits[name][1])
                show(light_so_far())
        status.sample = ""
        return {name: Picture.of(hits[name], lobes, layer.settings.exposure, encoded.tokens)
                for name, lobes in light_so_far().items()}

    def _encode(self, view: View):
        """The scene after stage 1, for this view and others of the same size."""
        if self._layer.settings.network.encodes_textures:
            with self._layer.plan.enter(TEXTURES):
                model_cache.prepare(self._renderer, self._scene, view.longer_side)
        with self._layer.plan.enter(ENCODE):
            return model_cache.encoded(self._renderer, self._scene, view.longer_side)

    def _light(self, encoded, view: View, guides: Guides) -> Lobes:
        """The network's light of one view."""
        layer = self._layer
        with layer.plan.enter(VIEW):
            if not layer.settings.network.has_lobes:
                lobes = Lobes(encoded.view(view, guides))
                if self._scene.negative is not None:
                    layer.report.approximated("Lamps", "negative light is ignored")
            elif self._scene.negative is None:
                lobes = encoded.lobes(view, guides, layer.with_lobes)
            else:
                negative, restored = self._negative_light(view, guides)
                lobes = encoded.lobes(view, restored, layer.with_lobes).without(negative)
        if layer.light_groups:
            with layer.plan.enter(GROUPS):
                if self._groups is None or self._groups.scene is not self._scene:
                    self._groups = GroupEstimates(self._renderer, self._scene, len(layer.light_groups), view)
                lobes = replace(lobes, groups=self._groups.light(view, guides, layer.settings.follows_specular_paths))
        self._report_remark()
        return lobes

    def _negative_light(self, view: View, guides: Guides) -> tuple[np.ndarray, Guides]:
        """(H, W, 3) radiance that lamps of negative strength take away, and the guides as they were without these.

        The network compares traced light with an estimate of the light of other lamps.
        """
        if self._negative is None or self._negative.scene is not self._scene:
            self._negative = LightSubset(self._renderer, self._scene, lit_by_negative(self._scene), view.longer_side)
        follows_paths = self._layer.settings.follows_specular_paths
        negative = self._negative.light(view, replace(guides, traced=None), follows_paths)
        if guides.traced is not None:
            bounced = self._negative.light(view, guides, follows_paths)
            guides = replace(guides, traced=guides.traced + (negative - bounced).clip(0))
        return negative, guides

    def _smooth_edges(self, encoded, picture: Picture, hits: FirstHits, wraps: bool) -> Picture:
        """The same picture with smooth edges, in its light and in emission and environment too.

        wraps: as View's. Nothing is smoothed into pixels that look nowhere.
        """
        guides, lobes, outside = picture.guides, picture.lobes, hits.outside
        rough = {"combined": picture.combined, "radiance": lobes.radiance} | {
            key: getattr(guides, key) for key in EMITTED}
        with self._layer.plan.enter(EDGES):
            smooth = encoded.antialiased(rough, lobes, guides, wraps)
        if outside is not None:
            black = outside & (guides.alpha == 0)
            for key, pixels in smooth.items():
                pixels[black] = rough[key][black]
        emitted = {key: smooth[key] for key in EMITTED}
        return Picture(smooth["combined"], replace(guides, **emitted), lobes.scaled_to(smooth["radiance"]),
                       picture.tokens)
