# SPDX-License-Identifier: GPL-3.0-or-later
"""Inference: a RenderScene and a View in, scene-linear radiance out.

Chooses device, precision and pipeline, normalises, keeps stage 1 of the last scene, pads views to what the network
accepts.
"""
from __future__ import annotations

import hashlib
from dataclasses import fields
from pathlib import Path

import numpy as np
import torch

from .camera import padded_view, place_in
from .errors import CheckpointError
from .guided.pipeline import GuidedPipeline
from .normalize import Normalization
from .precision import choose_device, choose_precision
from .published.bundle import is_bundle
from .published.pipeline import PublishedPipeline
from .scene import Guides, RenderScene, View


class Renderer:
    """A network ready to render. Not thread-safe; keep one per process and set of weights."""

    def __init__(self, weights: str | Path = "small", device: str = "auto", precision: str = "auto"):
        """weights: "small", a folder of this project's format, or a published bundle (a folder with model_index.json).

        Raises CheckpointError for unusable weights, ValueError for a device or precision that is not there.
        """
        self.device = choose_device(device)
        self.dtype = choose_precision(precision, self.device)
        pipeline = PublishedPipeline if weights != "small" and is_bundle(weights) else GuidedPipeline
        self.pipeline = pipeline(weights, self.device, self.dtype)
        self._stage1: tuple[tuple, tuple] | None = None

    def render(self, scene: RenderScene, view: View, guides: Guides, progress=None) -> np.ndarray:
        """(H, W, 3) f32 radiance of surfaces and volumes, premultiplied, scene-linear, row 0 on top.

        Directly seen emitters and the world are not in it: they are in `guides`. progress(text, fraction) is called
        at least every 0.2 s and may raise RenderCancelled. Raises CheckpointError when the picture is not finite.
        """
        progress = progress or (lambda text, fraction: None)
        with torch.inference_mode():
            normalization, encoded = self._encode(scene, view, progress)
            larger, guides = padded(view, guides)
            image = self.pipeline.image(encoded, normalization.view(larger), normalization.guides(guides),
                                        lambda text, fraction: progress(text, 0.5 + 0.5 * fraction))
            image = image[:, *place_in(larger, view)] / normalization.exposure
        if not image.isfinite().all():
            advice = "the weights may be damaged" if self.dtype == torch.float32 else "set Precision to Float32"
            raise CheckpointError(f"The network's picture holds values that are not finite: {advice}")
        return image.permute(1, 2, 0).cpu().numpy()

    def _encode(self, scene: RenderScene, view: View, progress) -> tuple:
        """Stage 1, or what is kept of it when the scene has not changed since the last call."""
        variant = self.pipeline.variant(view)
        key = fingerprint(scene), variant
        if self._stage1 is None or self._stage1[0] != key:
            self._stage1 = None
            progress("Preparing the scene", 0.0)
            normalization = Normalization.of(scene)
            encoded = self.pipeline.encode(normalization.scene(scene), variant,
                                           lambda text, fraction: progress(text, 0.5 * fraction))
            self._stage1 = key, (normalization, encoded)
        return self._stage1[1]

    @property
    def tokens(self) -> int:
        """Length of the token sequence of the last scene; 0 before the first."""
        return 0 if self._stage1 is None else len(self._stage1[1][1].context.positions)


def fingerprint(scene: RenderScene) -> bytes:
    """Changes whenever the content of the scene does."""
    digest = hashlib.blake2b(digest_size=16)
    _update(digest, scene)
    return digest.digest()


def _update(digest, part) -> None:
    for f in fields(part):
        value = getattr(part, f.name)
        if isinstance(value, np.ndarray):
            digest.update(f"{f.name}{value.shape}{value.dtype}".encode())
            digest.update(np.ascontiguousarray(value))
        elif value is not None:
            _update(digest, value)


def padded(view: View, guides: Guides) -> tuple[View, Guides]:
    """Extend the rectangle to what the network accepts; the outermost pixels are repeated there.

    A picture goes on beyond its edge, and the network's windows look there: an empty margin would darken the edge.
    """
    larger = padded_view(view)
    if (larger.width, larger.height) == (view.width, view.height):
        return view, guides
    rows, columns = place_in(larger, view)
    margins = [(rows.start, larger.height - rows.stop), (columns.start, larger.width - columns.stop)]
    arrays = {f.name: getattr(guides, f.name) for f in fields(Guides)}
    return larger, Guides(**{name: np.pad(array, margins + [(0, 0)] * (array.ndim - 2), mode="edge")
                             for name, array in arrays.items()})
