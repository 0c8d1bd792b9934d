# SPDX-License-Identifier: GPL-3.0-or-later
"""RenderScene -> inputs of the published network (docs/scene-input.md 3.3, 3.5, 4.1, 4.5, 7.4)."""
from __future__ import annotations

import numpy as np
import torch

from ..environment import environment_images
from ..errors import SceneError
from ..material.appearance import Appearance
from ..network.inputs import EnvironmentInputs, NetworkInputs, encode_light
from ..progress import part, report
from ..scene import ENVIRONMENT_SHAPE, RenderScene, constant_tile
from ..tensors import material_tiles, nearer_lights, volume_inputs
from .image_encoder import ImageEncoder
from .processed_scene import ProcessedScene

CHUNK = 64  # tiles whose texels go through the mappers at once
LIGHT_TILE = constant_tile((1, 1, 1), roughness=1, ior=1)  # what every emitter was in training


class SceneEncoder:
    """Mappers and image encoder in line; latents that it has seen are not computed again."""

    def __init__(self, appearance: Appearance, images: ImageEncoder):
        self.appearance, self.images = appearance, images

    def process(self, scene: RenderScene) -> ProcessedScene:
        """A normalised scene, without views."""
        tiles = np.concatenate([scene.tiles, LIGHT_TILE[None]])
        used, index = np.unique(np.where(scene.is_light, len(scene.tiles), scene.tile_index), return_inverse=True)
        return ProcessedScene(nearer_lights(scene), scene.normals, self._tile_latents(tiles, used),
                              index.reshape(-1), scene.emission, scene.environment, scene.volumes)

    def inputs(self, scene: ProcessedScene) -> NetworkInputs:
        """Tensors on the CPU; a raw texture is encoded, and no environment is a black one (m = 0)."""
        texture = torch.from_numpy(scene.texture)
        if scene.is_raw:
            texture = self._in_chunks(len(texture), lambda rows: texture[rows])
        elif texture.shape[1] != 5 * self.images.channels:
            raise SceneError(f"the scene's texture latents have {texture.shape[1]} channels, "
                             f"the network reads {5 * self.images.channels}")
        return NetworkInputs(
            triangles=torch.from_numpy(scene.triangles), normals=torch.from_numpy(scene.normals), texture=texture,
            texture_index=torch.from_numpy(scene.texture_index).long(),
            light=encode_light(torch.from_numpy(scene.light_strength)),
            environment=self._environment(scene.environment), volumes=volume_inputs(scene.volumes))

    def _environment(self, radiance: np.ndarray | None) -> EnvironmentInputs:
        if radiance is None:
            radiance = np.zeros(ENVIRONMENT_SHAPE, np.float32)
        ldr, hdr, strength = environment_images(radiance)
        with part(1.0, 1.0, "Encoding the environment"):
            latents = self.images(torch.from_numpy(np.stack([ldr, hdr])))
        return EnvironmentInputs(latents[0], latents[1], torch.tensor([strength]))

    def _tile_latents(self, tiles: np.ndarray, used: np.ndarray) -> np.ndarray:
        def raw(rows: slice) -> torch.Tensor:
            parts = material_tiles(torch.from_numpy(tiles[used[rows]]).float().to(self.images.device), self.appearance)
            emission = parts.new_zeros(len(parts), 3, *parts.shape[2:])  # never encoded
            return torch.cat([parts[:, :12], emission, parts[:, 12:]], 1).half().cpu()  # as files store it

        return self._in_chunks(len(used), raw).numpy()

    def _in_chunks(self, count: int, raw) -> torch.Tensor:
        """(count, 80, 4, 4) f16 latents of the raw tiles raw(slice)."""
        if not count:
            return torch.zeros(0, 5 * self.images.channels, 4, 4, dtype=torch.float16)
        chunks = []
        for begin in range(0, count, CHUNK):
            with part(begin / count, min(begin + CHUNK, count) / count, f"Encoding textures, {begin} of {count}"):
                report()
                groups = image_groups(raw(slice(begin, begin + CHUNK)))
                chunks.append(self.images(groups.flatten(0, 1)).unflatten(0, (-1, 5)).flatten(1, 2).half())
        return torch.cat(chunks)


def image_groups(raw: torch.Tensor) -> torch.Tensor:
    """(T, 15 or 16, q, q) raw tiles -> (T, 5, 3, q, q): 3 of the latent, normal, height (docs/scene-input.md 4.5)."""
    height = raw[:, 15:16] if raw.shape[1] == 16 else torch.zeros_like(raw[:, :1])
    return torch.cat([raw[:, :12].unflatten(1, (4, 3)), height[:, None].expand(-1, -1, 3, -1, -1)], 1)
