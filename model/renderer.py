# SPDX-License-Identifier: GPL-3.0-or-later
"""Inference: a RenderScene and a View in, scene-linear radiance out.

Chooses device and precision, normalises, keeps stage 1 of the last scene, pads views to what the network accepts.
"""
from __future__ import annotations

import hashlib
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import torch
from torch import nn

from .camera import view_rays
from .checkpoint import load_small
from .guidance import decode_light
from .guides import guide_tensors
from .light_prior import LightPrior
from .norm import Linear
from .normalize import Normalization
from .precision import choose_device, choose_precision
from .scene import Guides, RenderScene, View
from .scene_inputs import small_inputs

GRANULARITY = 64  # pixels: a Swin window (spec/network.md 8.3)


class Renderer:
    """A network ready to render. Not thread-safe; keep one per process and set of weights."""

    def __init__(self, weights: str | Path = "small", device: str = "auto", precision: str = "auto", progress=None):
        """Raises CheckpointError for unusable weights, ValueError for a device or precision that is not there."""
        self.device = choose_device(device)
        self.dtype = choose_precision(precision, self.device)
        self.model, self.mapper = load_small(weights)
        self.model = in_precision(self.model, self.dtype).to(self.device).eval()
        self._stage1: tuple[bytes, tuple] | None = None

    def render(self, scene: RenderScene, view: View, guides: Guides, progress=None) -> np.ndarray:
        """(H, W, 3) f32 radiance of surfaces and volumes, premultiplied, scene-linear, row 0 on top.

        Directly seen emitters and the world are not in it: they are in `guides`. progress(text, fraction) is called
        at least every 0.2 s and may raise RenderCancelled.
        """
        progress = progress or (lambda text, fraction: None)
        with torch.inference_mode():
            normalization, normalized, prior, context = self._encode(scene, progress)
            width, height = view.width, view.height
            view, guides = padded(view, guides)
            guides = normalization.guides(guides)
            view = normalization.view(view)
            progress("Light prior", 0.55)
            tensors = guide_tensors(normalized, view, guides, prior)
            origin, rays = (torch.from_numpy(x).to(self.device)[None] for x in view_rays(view))
            raw = self.model.render_view(
                context, origin, rays, ray_embedding=self.model.guidance.bundles(tensors),
                ray_position=tensors.positions, extra=tensors.features, raw=True,
                progress=lambda text, fraction: progress(text, 0.6 + 0.4 * fraction))
            image = decode_light(raw, tensors)["image"][0] / normalization.exposure
        return image[:, :height, :width].permute(1, 2, 0).cpu().numpy()

    def _encode(self, scene: RenderScene, progress) -> tuple:
        """Stage 1, or what is kept of it when the scene has not changed since the last call."""
        key = fingerprint(scene)
        if self._stage1 is None or self._stage1[0] != key:
            self._stage1 = None
            progress("Preparing the scene", 0.0)
            normalization = Normalization.of(scene)
            normalized = normalization.scene(scene)
            inputs = small_inputs(normalized, self.mapper).to(self.device)
            lights = normalized.is_light
            beams = self.model.guidance.beams(*(torch.as_tensor(x[lights], device=self.device)
                                                for x in (scene.beam_axis, scene.beam_cosine)))
            context = self.model.encode_scene(inputs, light_embedding=beams,
                                              progress=lambda text, fraction: progress(text, 0.5 * fraction))
            prior = LightPrior(normalized, self.device)
            self._stage1 = key, (normalization, normalized, prior, context)
        return self._stage1[1]

    @property
    def tokens(self) -> int:
        """Length of the token sequence of the last scene; 0 before the first."""
        return 0 if self._stage1 is None else len(self._stage1[1][3].positions)


def in_precision(model: nn.Module, dtype: torch.dtype) -> nn.Module:
    """Store the weights of matrix products and convolutions in `dtype`; norms and learned tokens stay float32."""
    for module in model.modules():
        if isinstance(module, (Linear, nn.Conv2d, nn.ConvTranspose2d)):
            module.to(dtype)
    return model


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
    """Extend the rectangle to the right and below to multiples of 64 pixels; nothing is hit there."""
    right, below = -view.width % GRANULARITY, -view.height % GRANULARITY
    if not right and not below:
        return view, guides
    margins = {}
    for f in fields(Guides):
        array = getattr(guides, f.name)
        fill = -1 if f.name == "hit_triangle" else 0
        margins[f.name] = np.pad(array, [(0, below), (0, right)] + [(0, 0)] * (array.ndim - 2), constant_values=fill)
    return replace(view, width=view.width + right, height=view.height + below), Guides(**margins)
