# SPDX-License-Identifier: GPL-3.0-or-later
"""Inference: encode a RenderScene once, then render any number of Views of it to scene-linear radiance.

    pictures = Renderer().render(scene, [view])
or, with first hits and traced light of Cycles,
    radiance = Renderer().encode(scene).view(view, guides)

A pipeline is one of the two ways from a normalised scene to a picture, guided/pipeline.py and published/pipeline.py:
    granularity                     the view's sides are multiples of it
    variant(picture_size)           which of its networks renders pictures whose longer side has so many pixels
    encode(scene, variant)          stage 1; the result has `.tokens`, their number
    image(encoded, view, guides, effort)    (3, H, W) f32 radiance in network exposure, without emitters seen directly
and the guided one also gives `lobes`, the same by lobe, pictures `antialiased`, and a `draft` of a scene.
"""
from __future__ import annotations

import gc
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
import torch
from torch import Tensor

from .camera import extend_sides, find_window, pad_view
from .compute.devices import choose_device, device_name
from .compute.inference import Pieces, inference
from .compute.precision import NAMES, choose_precision, find_failure
from .errors import CheckpointError
from .first_hits.camera_rays import SPREAD, cast_guides
from .guided.pipeline import GuidedPipeline
from .light.effort import FULL, Effort
from .light_passes import Lobes
from .normalize import Normalization
from .pipeline import Encoded, LobePipeline
from .progress import report
from .published.bundle_files import AUTOMATIC, is_bundle
from .published.pipeline import PublishedPipeline
from .published.processed_scene import ProcessedScene
from .scene import Guides, RenderScene, View
from .weights.files import checkpoint_errors
from .weights.presets import BUNDLED, weights_folder

T = TypeVar("T")


class Renderer:
    """A network ready to render. Not thread-safe; keep one per process and set of weights."""

    def __init__(self, weights: str | Path = BUNDLED, device: str = "auto", precision: str = "auto",
                 transformer: str = AUTOMATIC, latents: Path | None = None, rays: bool = True):
        """weights: a preset that comes with the add-on, a folder of this project's format, or a published bundle, of
        which a transformer may be chosen (published/bundle_files.py), and which keeps textures in the file `latents`.
        rays: whether networks of this project's format get light that is estimated by rays.

        Raises CheckpointError for unusable weights, ValueError for a device or precision that is not there. `remark`
        says afterwards what automatic choices had to do without, "" for nothing.
        """
        self.pieces = Pieces()
        self.device = choose_device(device)
        self.dtype, self.remark = choose_precision(precision, self.device), ""
        if precision == "auto" and self.dtype != torch.float32 and (problem := find_failure(self.dtype, self.device)):
            self.remark = f"{NAMES[self.dtype]} does not work in this PyTorch ({problem}): Float32 is used"
            self.dtype = torch.float32
        with checkpoint_errors():
            published = is_bundle(weights_folder(weights))
        self.pipeline = (PublishedPipeline(weights, self.device, self.dtype, transformer, latents) if published
                         else GuidedPipeline(weights, self.device, self.dtype, rays))

    @property
    def computed_on(self) -> str:
        """The device and the number format, as in "CPU (AMD EPYC), BFloat16"."""
        return f"{device_name(self.device)}, {NAMES[self.dtype]}"

    def fitted(self, compute: Callable[[], T]) -> T:
        """compute() inside `inference()`, again in smaller pieces where a card's memory is too small; `remark` says so.

        Raises torch.OutOfMemoryError when it is too small for the smallest ones.
        """
        while True:
            try:
                with inference(self.pieces):
                    return compute()
            except torch.OutOfMemoryError:
                if not self.pieces.shrink():
                    raise
            gc.collect()
            if self.device.type == "cuda":
                torch.cuda.empty_cache()
            self.remark = ("the memory of the card was too small for the usual pieces, so it worked in smaller ones: "
                           "lower Max Triangles or the resolution for more speed")

    def render(self, scene: RenderScene | ProcessedScene, views: Sequence[View] = (), resolution: int = 512,
               batch: int = 1) -> list[np.ndarray]:
        """Pictures (H, W, 3) f32, radiance, scene-linear, row 0 on top.

        Of a RenderScene those of `views`, with the lamps and the world that they see; first hits are found by our own
        rays. Of a ProcessedScene, which published/h5.py reads, those of its own views, square, `batch` at once.
        Raises CheckpointError for a ProcessedScene and weights that are not published, and when a picture is not
        finite.
        """
        if isinstance(scene, ProcessedScene):
            if not isinstance(self.pipeline, PublishedPipeline):
                raise CheckpointError("H5 scenes hold latents of the published weights: give their folder")
            return list(self.fitted(lambda: self.pipeline.render_processed(scene, resolution, batch)))
        encoded = {}
        pictures = []
        for view in views:
            variant = self.pipeline.variant(view.longer_side)
            if variant not in encoded:
                encoded = {variant: self.encode(scene, view.longer_side)}
            pictures.append(encoded[variant].picture(view, cast_guides(scene, view, SPREAD)))
        return pictures

    def prepare(self, scene: RenderScene) -> None:
        """What `encode` can keep of a scene in world units for later renders: published weights' textures."""
        normalized = Normalization.of(scene).scene(scene)
        self.fitted(lambda: self.pipeline.prepare(normalized))

    def encode(self, scene: RenderScene, picture_size: int = 512, draft: bool = False) -> EncodedScene:
        """Stage 1 of a scene in world units, for pictures whose longer side has so many pixels.

        draft: without stage 1, for first pictures, where the network can do without; `EncodedScene.finished` adds it.
        """
        report(0.0, "Preparing the scene")
        normalization, variant = Normalization.of(scene), self.pipeline.variant(picture_size)
        draft = draft and isinstance(self.pipeline, LobePipeline)
        normalized, encode = normalization.scene(scene), self.pipeline.draft if draft else self.pipeline.encode
        encoded = self.fitted(lambda: encode(normalized, variant))
        return EncodedScene(self, normalization, variant, encoded)


@dataclass
class EncodedScene:
    """A scene after stage 1, independent of the camera."""

    renderer: Renderer
    normalization: Normalization
    variant: str
    encoded: Encoded

    @property
    def is_draft(self) -> bool:
        return self.encoded.is_draft

    def finished(self) -> EncodedScene:
        """The scene of a draft after stage 1."""
        renderer = self.renderer
        return replace(self, encoded=renderer.fitted(lambda: renderer.pipeline.finished(self.encoded)))

    def view(self, view: View, guides: Guides, effort: Effort = FULL) -> np.ndarray:
        """(H, W, 3) f32 radiance of surfaces and volumes, premultiplied, scene-linear, row 0 on top.

        View and guides are in world units, as the scene was. Directly seen emitters and the world are not in the
        picture: they are in `guides`. Raises CheckpointError when the picture is not finite, ValueError for a view that
        another network of the bundle renders.
        """
        image = self.renderer.pipeline.image
        return self._rendered(view, guides, lambda *inputs: {"image": image(*inputs, effort)})["image"]

    def picture(self, view: View, guides: Guides) -> np.ndarray:
        """(H, W, 3) f32 radiance on an opaque film: what `view` returns, and emitters and world that are seen directly.

        Edges are smoothed if the network knows how. Raises as `view` does.
        """
        seen = guides.emission + guides.environment
        if not isinstance(self.renderer.pipeline, LobePipeline):
            return self.view(view, guides) + seen
        lobes = self.lobes(view, guides, apart=False)
        return self.antialiased({"picture": lobes.radiance + seen}, lobes, guides, view.wraps)["picture"]

    def lobes(self, view: View, guides: Guides, apart: bool = True) -> Lobes:
        """The same and what is traced light in it, `apart` with the light of each lobe: guided networks alone know it.

        Raises as `view` does.
        """
        lobes = self.renderer.pipeline.lobes
        return Lobes(**self._rendered(view, guides, lambda *inputs: lobes(*inputs, apart)))

    def antialiased(self, pictures: dict[str, np.ndarray], lobes: Lobes, guides: Guides,
                    wraps: bool = False) -> dict[str, np.ndarray]:
        """All `pictures` (H, W, C) f32, with the edges of the view of `lobes` as more samples would show them.

        They are made of the view's light or its guides. wraps: as View's. Guided networks alone know how.
        """
        antialiased = self.renderer.pipeline.antialiased
        return self.renderer.fitted(lambda: antialiased(pictures, lobes, guides, wraps))

    def _rendered(self, view: View, guides: Guides, run: Callable[..., dict[str, Tensor]]) -> dict[str, np.ndarray]:
        """What run(encoded, view, guides) makes in network units, (..., 3, H, W), as world radiance (..., H, W, 3).

        "latent" is no radiance, and stays as it is.
        """
        pipeline = self.renderer.pipeline
        variant = pipeline.variant(view.longer_side)
        if variant != self.variant:
            raise ValueError(f"the scene was encoded for {self.variant}, this view needs {variant}")
        larger, guides = padded(view, guides, pipeline.granularity)
        window = (..., *find_window(larger, view))
        inputs = self.normalization.view(larger), self.normalization.guides(guides)
        pictures = self.renderer.fitted(lambda: {
            name: radiance[window] / (1 if name == "latent" else self.normalization.exposure)
            for name, radiance in run(self.encoded, *inputs).items()})
        if not all(radiance.isfinite().all() for radiance in pictures.values()):
            exact = self.renderer.dtype == torch.float32
            advice = "the weights may be damaged" if exact else "set Precision to Float32"
            raise CheckpointError(f"The network's picture holds values that are not finite: {advice}")
        return {key: radiance.movedim(-3, -1).cpu().numpy() for key, radiance in pictures.items()}

    @property
    def tokens(self) -> int:
        """Length of the scene's token sequence."""
        return self.encoded.tokens


def padded(view: View, guides: Guides, granularity: int) -> tuple[View, Guides]:
    """Extend the rectangle to what the network accepts; the outermost pixels are repeated there.

    A picture goes on beyond its edge, and the network's windows look there: an empty margin would darken the edge, and
    sides that are neighbours would not meet.
    """
    larger = pad_view(view, granularity)
    if (larger.width, larger.height) == (view.width, view.height):
        return view, guides
    rows, columns = find_window(larger, view)
    margins = [(rows.start, larger.height - rows.stop), (columns.start, larger.width - columns.stop)]
    return larger, Guides(**{name: extend_sides(np.pad(array, margins[:1] + [(0, 0)] * (array.ndim - 1), mode="edge"),
                                                *margins[1], view.wraps) for name, array in guides.arrays().items()})
