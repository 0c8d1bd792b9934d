# SPDX-License-Identifier: GPL-3.0-or-later
"""The paper's network and the paper's input (docs/scene-input.md; paper, Method)."""
from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from ..camera import pad_view, square_view
from ..compute.inference import inference
from ..compute.precision import tensor_float_32
from ..errors import CheckpointError
from ..light.effort import FULL, Effort
from ..material.mappers import Appearance
from ..network.inputs import NetworkInputs, view_inputs
from ..network.renderformer import RenderFormer, SceneContext, store_as_released, to_radiance
from ..normalize import Normalization
from ..pipeline import Pipeline
from ..progress import part, report, steps
from ..scene import Guides, RenderScene, View
from ..weights.files import checkpoint_errors
from ..weights.presets import rf2_200m
from .as_trained import as_trained, find_emitters
from .bundle import Bundle, load_transformer
from .bundle_files import AUTOMATIC, MAPPERS, bundle_and_transformer, choose_transformer
from .cube_faces import cube_faces, join_faces
from .image_encoder import ImageEncoder, find_vae
from .latent_store import LatentStore
from .processed_scene import ProcessedScene, square_fov
from .scene_encoder import SceneEncoder


@dataclass
class PublishedContext:
    """A scene after stage 1, and the network that made it."""

    emitters: np.ndarray  # (N,) bool: which triangles of the whole scene are lights for the network
    network: RenderFormer
    context: SceneContext
    is_draft = False

    @property
    def tokens(self) -> int:
        return len(self.context.positions)


class PublishedPipeline(Pipeline):
    """Two networks, for pictures below and from 2048 pixels, or the chosen one; the one in use is in memory."""

    def __init__(self, folder: str | Path, device: torch.device, dtype: torch.dtype, transformer: str = AUTOMATIC,
                 latents: Path | None = None):
        """folder: of the bundle, or of the transformer in it that is chosen. latents: file of a LatentStore.

        Raises CheckpointError for what is missing, VAE and diffusers included.
        """
        with checkpoint_errors():
            folder, self.chosen = bundle_and_transformer(Path(folder), transformer)
        self.device, self.dtype, self.bundle = device, dtype, Bundle(folder).require_parts(self.chosen)
        self.granularity = rf2_200m().granularity
        mappers = (self.bundle.mapper(name).to(device) for name in MAPPERS)
        images = ImageEncoder(find_vae(self.bundle.folder), device, dtype)
        self.encoder = SceneEncoder(Appearance(*mappers), images, LatentStore(latents))
        self._network: tuple[str, RenderFormer] | None = None

    def variant(self, picture_size: int) -> str:
        return choose_transformer(self.bundle.folder, picture_size, self.chosen)

    def prepare(self, scene: RenderScene) -> None:
        """Cache the latents of textures and environment, which later renders share."""
        self.encoder.encode(as_trained(scene, find_emitters(scene)))

    def encode(self, scene: RenderScene, variant: str) -> PublishedContext:
        emits = find_emitters(scene)
        with part(0.0, 0.4):
            inputs = self.encoder.inputs(self.encoder.process(as_trained(scene, emits)))
        with part(0.4, 1.0):
            network, context = self._stage1(inputs, variant)
        return PublishedContext(emits, network, context)

    def image(self, encoded: PublishedContext, view: View, guides: Guides, effort: Effort = FULL) -> torch.Tensor:
        rendered = (self._view(encoded, view) if view.panorama is None
                    else join_faces(view, cube_faces(view, self.granularity), lambda face: self._view(encoded, face)))
        return rendered * torch.from_numpy(displayed_pixels(guides, encoded.emitters)).to(self.device)

    def process(self, scene: RenderScene, views: list[View]) -> ProcessedScene:
        """A scene and its views (world frame) ready for h5.py: normalised, because the research code does not.

        Pictures of it are in network exposure; metadata["normalization"] holds center, scale, exposure to go back.
        Raises SceneError for a view that is no centred perspective.
        """
        normalization = Normalization.of(scene)
        fov = np.float32([square_fov(view) for view in views])
        with inference():
            normalized = normalization.scene(scene)
            processed = self.encoder.process(as_trained(normalized, find_emitters(normalized)))
        cameras = np.stack([normalization.view(view).camera_to_world for view in views])
        return replace(processed, camera_to_world=cameras, fov=fov,
                       metadata={"normalization": {"center": normalization.center.tolist(),
                                                   "scale": float(normalization.scale),
                                                   "exposure": float(normalization.exposure)}})

    def render_processed(self, scene: ProcessedScene, resolution: int = 512, batch: int = 1) -> np.ndarray:
        """(V, R, R, 3) f32 radiance of all views as the research code renders them: no normalisation, no guides.

        batch: views that the network draws at once. Unlike there, values are not negative and R need not be a multiple
        of 64. Raises SceneError for latents of another encoder, CheckpointError when a picture is not finite.
        """
        views = [pad_view(square_view(c2w, fov, resolution), self.granularity)
                 for c2w, fov in zip(scene.camera_to_world, scene.fov)]
        with inference():
            with part(0.0, 0.3):
                inputs = self.encoder.inputs(scene)
            with part(0.3, 0.6):
                network, context = self._stage1(inputs, self.variant(resolution))
            encoded = PublishedContext(inputs.is_light.numpy(), network, context)
            with part(0.6, 1.0):
                images = torch.cat([self._views(encoded, views[i:i + batch])
                                    for i in steps(range(0, len(views), batch))])
        if not images.isfinite().all():
            raise CheckpointError("the network's picture holds values that are not finite: move and scale the scene to "
                                  f"about [-0.5, 0.5], or get the weights in {self.bundle.folder} again")
        return images[..., :resolution, :resolution].movedim(1, -1).cpu().numpy()

    def load(self, variant: str) -> RenderFormer:
        """The network of one `variant`, on the CPU in float32. Raises CheckpointError."""
        network = load_transformer(self.bundle.folder / variant)
        if network.config.texture_channels != 5 * self.encoder.images.channels:
            raise CheckpointError(f"{self.bundle.folder / variant} reads {network.config.texture_channels} texture "
                                  f"channels, the VAE makes {5 * self.encoder.images.channels}: it is another one")
        return network

    def _stage1(self, inputs: NetworkInputs, variant: str) -> tuple[RenderFormer, SceneContext]:
        report(0.0, f"Loading {variant}")
        if self._network is None or self._network[0] != variant:
            self._network = None
            network = store_as_released(self.load(variant), self.dtype, self.device).to(self.device).eval()
            self._network = variant, network
        network = self._network[1]
        return network, network.encode_scene(inputs.to(self.device))

    def _view(self, encoded: PublishedContext, view: View) -> torch.Tensor:
        return self._views(encoded, [view])[0]

    def _views(self, encoded: PublishedContext, views: list[View]) -> torch.Tensor:
        """(V, 3, H, W) radiance of views of one size."""
        with tensor_float_32(self.device):
            log_image = encoded.network.render_view(encoded.context, view_inputs(*views).to(self.device))
        return to_radiance(log_image).clamp(min=0)


def displayed_pixels(guides: Guides, emitters: np.ndarray) -> np.ndarray:
    """(H, W) bool: pixels that show the network's picture; emitters: (N,) bool, triangles that are lights.

    Training pictures have a transparent film, so partly covered pixels are premultiplied by the network itself: the
    guides' coverage only clears pixels that show nothing. Lights were invisible to the camera: where one is seen, the
    network shows what is behind it, and the guides' emission replaces that.
    """
    emitter = (guides.emission > 0).any(-1) & (guides.hit_triangle >= 0)
    if emitter.any():
        emitter[emitter] = emitters[guides.hit_triangle[emitter]]
    return (guides.alpha > 0) & ~emitter
