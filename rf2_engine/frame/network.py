# SPDX-License-Identifier: GPL-3.0-or-later
"""The network's part of a view layer: add light to Cycles' first hits, once or for every sample."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...model import progress
from ...model.light_passes import Lobes, MeanLobes
from ...model.scene import Guides, RenderScene, View
from ...model.weights.presets import BUNDLED
from ..progress.stages import CONVERT, EDGES, ENCODE, LOAD, TEXTURES, VIEW
from ..runtime import model_cache
from . import shutter
from .hits import Hits, sample_hits
from .layer import Layer
from .output import SHINING


@dataclass
class Picture:
    """A view of a view layer as far as it is rendered; `tokens` are those of its last scene."""

    combined: np.ndarray  # (H, W, 4)
    guides: Guides
    lobes: Lobes
    tokens: int = 0

    @classmethod
    def dark(cls, hits: Hits, exposure: float) -> Picture:
        """Before the network has added anything."""
        black = np.zeros((*hits.guides.alpha.shape, 3), np.float32)
        return cls(hits.combined(black, exposure), hits.guides, Lobes(black))


class Network:
    """Of one view layer. It is given back with this object, but for what model_cache keeps."""

    def __init__(self, layer: Layer, scene: RenderScene) -> None:
        """Weights other than the bundled ones are loaded now: wrong ones are found before Cycles works for nothing."""
        self._layer, self._scene, self._renderer = layer, scene, None
        self._has_content = bool(len(scene) or scene.volumes)
        if self._has_content and layer.settings.weights != BUNDLED:
            self.load()
        model_cache.begin_import()  # while Cycles works, which leaves Python alone

    def load(self) -> None:
        """To be called before it works; PyTorch was imported meanwhile."""
        if self._renderer is None:
            settings = self._layer.settings
            with self._layer.plan.enter(LOAD):
                self._renderer = model_cache.renderer(settings.weights, settings.device, settings.precision,
                                                      settings.transformer)
            self._layer.device = self._renderer.computed_on
            self._tell()
            if unused := model_cache.unused_card(self._renderer) if settings.device == "auto" else "":
                self._layer.report.approximated("Device", unused)

    def _tell(self) -> None:
        """What the renderer had to do without."""
        if self._renderer.remark:
            self._layer.report.approximated("Device", self._renderer.remark)

    def has_work(self, guides: Guides) -> bool:
        """Whether anything is seen that it could light."""
        return self._has_content and bool(guides.alpha.any() or guides.transmission_color.any())

    def sharp(self, name: str, view: View, hits: Hits) -> Picture:
        """The picture of the view of that name as a pinhole sees it."""
        status = self._layer.status
        status.sample = name and f"View {name}"
        settings, guides = self._layer.settings, hits.guides
        encoded = self._encoded(view)
        lobes = self._lobes(encoded, view, guides)
        picture = Picture(hits.combined(lobes.radiance, settings.exposure), guides, lobes, encoded.tokens)
        smooth = settings.guided and hits.catch is None
        if smooth:
            picture = self._antialiased(encoded, picture, view.wraps, hits.outside)
        status.sample = ""
        return picture

    def blurred(self, hits: dict[str, Hits], show: Callable[[dict[str, Lobes]], None]) -> dict[str, Picture]:
        """The pictures of all views with the network's light as the mean of the samples of the optics.

        Nothing is computed twice: without a change in the scene but for the camera it stays encoded, and where nothing
        changes at all the sample before counts again. `hits` are those of the blurred picture, as Cycles gives them;
        what there is so far is given to `show`, for every session of Cycles puts something else on screen.
        """
        layer, means, encoded = self._layer, {name: MeanLobes() for name in hits}, None
        optics, status = layer.optics, layer.status

        def so_far() -> dict[str, Lobes]:
            return {name: mean.mean(hits[name].guides) for name, mean in means.items()}
        with shutter.clock(layer.engine, layer.depsgraph) as move_to:
            for number, frame in enumerate(optics.frames(layer.depsgraph)):
                status.sample = f"Sample {number + 1} of {optics.samples}"
                progress.report()
                moved = move_to(frame)
                if "scene" in moved:
                    with layer.plan.enter(CONVERT):
                        self._scene, encoded = layer.scene(), None
                if number == 0 or moved or optics.lens > 1:
                    seen, lobes = sample_hits(layer, self._scene, number), {}
                    for name, (view, guides) in seen.items():
                        encoded = encoded or self._encoded(view)
                        lobes[name] = self._lobes(encoded, view, guides)
                for name, mean in means.items():
                    mean.add(lobes[name], seen[name][1])
                show(so_far())
        status.sample = ""
        return {name: Picture(hits[name].combined(lobes.radiance, layer.settings.exposure), hits[name].guides, lobes,
                              encoded.tokens) for name, lobes in so_far().items()}

    def _encoded(self, view: View):
        """The scene after stage 1, for this view and others of the same size."""
        if not self._layer.settings.guided:
            with self._layer.plan.enter(TEXTURES):
                model_cache.prepare(self._renderer, self._scene, view.longer_side)
        with self._layer.plan.enter(ENCODE):
            return model_cache.encoded(self._renderer, self._scene, view.longer_side)

    def _lobes(self, encoded, view: View, guides: Guides) -> Lobes:
        """The network's light of one view."""
        layer = self._layer
        with layer.plan.enter(VIEW):
            found = encoded.lobes(view, guides, layer.lit) if layer.settings.guided else Lobes(
                encoded.view(view, guides))
        self._tell()
        return found

    def _antialiased(self, encoded, picture: Picture, wraps: bool, outside: np.ndarray | None) -> Picture:
        """The same with smooth edges: the picture, the light in it, and what is seen to shine.

        wraps: as View's. outside: (H, W) pixels that look nowhere; nothing is smoothed into them.
        """
        guides, lobes = picture.guides, picture.lobes
        rough = {"combined": picture.combined, "radiance": lobes.radiance} | {
            key: getattr(guides, key) for key in SHINING}
        with self._layer.plan.enter(EDGES):
            smooth = encoded.antialiased(rough, lobes, guides, self._layer.settings.guide_samples, wraps)
        if outside is not None:
            black = outside & (guides.alpha == 0)
            for key, pixels in smooth.items():
                pixels[black] = rough[key][black]
        shining = {key: smooth[key] for key in SHINING}
        return Picture(smooth["combined"], replace(guides, **shining), lobes.scaled_to(smooth["radiance"]),
                       picture.tokens)
