# SPDX-License-Identifier: GPL-3.0-or-later
"""The paper's network and the paper's input (spec/scene-input.md; paper, Method)."""
from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from ..camera import padded_view, square_view, view_rays
from ..errors import CheckpointError
from ..material.appearance import Appearance
from ..network.inputs import NetworkInputs
from ..network.renderformer import RenderFormer, SceneContext, to_radiance
from ..normalize import Normalization
from ..precision import in_precision
from ..scene import Guides, RenderScene, View
from .bundle import Bundle, load_transformer, transformer_name
from .image_encoder import ImageEncoder, find_vae
from .processed_scene import ProcessedScene, square_fov
from .scene_encoder import SceneEncoder

MAPPERS = ("diffspec_mapper", "metallic_mapper", "metallic_transmission_mapper")


@dataclass
class EncodedScene:
    emitters: np.ndarray  # (N,) bool
    model: RenderFormer
    context: SceneContext


class PublishedPipeline:
    """Two networks, for pictures below and from 2048 pixels; the one in use is in memory."""

    def __init__(self, folder: str | Path, device: torch.device, dtype: torch.dtype):
        """Raises CheckpointError for what is missing from the bundle, the VAE's folder and diffusers included."""
        self.device, self.dtype, self.bundle = device, dtype, Bundle(folder)
        mappers = (self.bundle.mapper(name).to(device) for name in MAPPERS)
        self.encoder = SceneEncoder(Appearance(*mappers), ImageEncoder(find_vae(self.bundle.folder), device))
        self._network: tuple[str, RenderFormer] | None = None

    def variant(self, view: View) -> str:
        """By the longer side of the whole picture: a render border shows the same pixels as the full frame."""
        return transformer_name(view.picture_size or max(view.width, view.height))

    def encode(self, scene: RenderScene, variant: str, progress) -> EncodedScene:
        processed = self.encoder.process(scene, lambda text, fraction: progress(text, 0.4 * fraction))
        inputs = self.encoder.inputs(processed, lambda text, fraction: progress(text, 0.4))
        model, context = self._stage1(inputs, variant, lambda text, fraction: progress(text, 0.4 + 0.6 * fraction))
        return EncodedScene(scene.is_light, model, context)

    def image(self, encoded: EncodedScene, view: View, guides: Guides, progress) -> torch.Tensor:
        """Training pictures have a transparent film, so partly covered pixels are premultiplied by the network itself:
        the guides' coverage only clears pixels that show nothing. Lights were invisible to the camera: where one is
        seen, the network shows what is behind it, and the guides' emission replaces that.
        """
        radiance = self._view(encoded, view, progress)
        seen = guides.hit_triangle >= 0
        emitter = (guides.emission > 0).any(-1) & seen
        if emitter.any():
            emitter[emitter] = encoded.emitters[guides.hit_triangle[emitter]]
        shown = (guides.alpha > 0) & ~emitter
        return radiance * torch.from_numpy(shown).to(self.device)

    def process(self, scene: RenderScene, views: list[View], progress=None) -> ProcessedScene:
        """A scene and its views (world frame) ready for model/h5.py: normalised, because the research code does not.

        Pictures of it are in network exposure; metadata["normalization"] holds center, scale, exposure to go back.
        Raises SceneError for a view that is no centred perspective.
        """
        normalization = Normalization.of(scene)
        fov = np.float32([square_fov(view) for view in views])
        with torch.inference_mode():
            processed = self.encoder.process(normalization.scene(scene), progress or (lambda text, fraction: None))
        cameras = np.stack([normalization.view(view).camera_to_world for view in views])
        return replace(processed, camera_to_world=cameras, fov=fov,
                       metadata={"normalization": {"center": normalization.center.tolist(),
                                                   "scale": float(normalization.scale),
                                                   "exposure": float(normalization.exposure)}})

    def render_processed(self, scene: ProcessedScene, resolution: int = 512, progress=None) -> np.ndarray:
        """(V, R, R, 3) f32 radiance of all views as the research code renders them: no normalisation, no guides.

        Unlike there, values are not negative and R need not be a multiple of 64.
        Raises SceneError for latents of another encoder; progress(text, fraction) may raise to cancel.
        """
        progress = progress or (lambda text, fraction: None)
        views = [square_view(c2w, fov, resolution) for c2w, fov in zip(scene.camera_to_world, scene.fov)]
        with torch.inference_mode():
            inputs = self.encoder.inputs(scene, lambda text, fraction: progress(text, 0.3 * fraction))
            variant = transformer_name(resolution)
            model, context = self._stage1(inputs, variant, lambda text, fraction: progress(text, 0.3 + 0.3 * fraction))
            encoded = EncodedScene(inputs.is_light.numpy(), model, context)
            images = [self._view(encoded, padded_view(view), lambda text, fraction, i=i: progress(
                text, 0.6 + 0.4 * (i + fraction) / len(views))) for i, view in enumerate(views)]
        return np.stack([image[:, :resolution, :resolution].permute(1, 2, 0).cpu().numpy() for image in images])

    def _stage1(self, inputs: NetworkInputs, variant: str, progress) -> tuple[RenderFormer, SceneContext]:
        progress(f"Loading {variant}", 0.0)
        if self._network is None or self._network[0] != variant:
            self._network = None
            model = load_transformer(self.bundle.folder / variant)
            if model.config.texture_channels != 5 * self.encoder.images.channels:
                raise CheckpointError(f"{self.bundle.folder / variant} reads {model.config.texture_channels} texture "
                                      f"channels, the VAE makes {5 * self.encoder.images.channels}: it is another one")
            self._network = variant, in_precision(model, self.dtype).to(self.device).eval()
        model = self._network[1]
        return model, model.encode_scene(inputs.to(self.device), progress=progress)

    def _view(self, encoded: EncodedScene, view: View, progress) -> torch.Tensor:
        origin, rays = (torch.from_numpy(x).to(self.device)[None] for x in view_rays(view))
        return to_radiance(encoded.model.render_view(encoded.context, origin, rays, progress=progress))[0].clamp(min=0)
