# SPDX-License-Identifier: GPL-3.0-or-later
"""RenderScene -> inputs of the published network (docs/scene-input.md 3.3, 3.5, 4.1, 4.5, 7.4)."""
from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch

from ..beams import smoothed
from ..environment import environment_images
from ..errors import SceneError
from ..material.mappers import LATENT_DIM, Appearance
from ..network.inputs import (
    EnvironmentInputs,
    NetworkInputs,
    bring_lights_near,
    encode_light,
    material_tiles,
    trained_tiles,
    volume_inputs,
)
from ..progress import part, report
from ..scene import ENVIRONMENT_SHAPE, RenderScene
from .image_encoder import ImageEncoder
from .latent_store import LatentStore
from .processed_scene import ProcessedScene
from .v1_textures import BRDF, V1, fill_tiles

CHUNK = 64       # tiles whose texels go through the mappers at once
PREPARATION = 1  # to be raised when tiles or environments are prepared in another way: what is stored is old then


class SceneEncoder:
    """Mappers and image encoder in line; latents that are in the store, or were computed before, are reused."""

    def __init__(self, appearance: Appearance, images: ImageEncoder, store: LatentStore | None = None):
        self.appearance, self.images, self.store = appearance, images, store or LatentStore()
        self._identity = digest(images.identity, str(PREPARATION).encode(),
                                *(p.cpu().numpy() for mapper in appearance.mappers for p in mapper.parameters()))

    def encode(self, scene: RenderScene) -> None:
        """Latents of a normalised scene into the store, so that `process` and `inputs` find them there."""
        self.process(scene)
        self._environment(scene.environment)

    def process(self, scene: RenderScene) -> ProcessedScene:
        """A normalised scene, without views."""
        tiles, index = trained_tiles(scene)
        used, index = np.unique(index, return_inverse=True)
        own_latents = np.concatenate([scene.tile_latents, np.zeros((1, LATENT_DIM), np.float32)])
        lobes = None if scene.two_lobes is None else np.concatenate([
            scene.two_lobes, np.zeros((1, *scene.two_lobes.shape[1:]), np.float16)])[used]
        texture = self._tile_latents(tiles[used], own_latents[used], lobes)
        return ProcessedScene(bring_lights_near(scene), scene.normals, texture, index.reshape(-1),
                              smoothed(scene.emission, scene.beam_cosine)[0],
                              scene.environment, scene.volumes)

    def inputs(self, scene: ProcessedScene) -> NetworkInputs:
        """Tensors on the CPU; a raw texture is encoded, and no environment is a black one (m = 0).

        Raises SceneError for latents of another encoder.
        """
        self.require_known(scene)
        texture = torch.from_numpy(self.encoded(scene).texture)
        return NetworkInputs(
            triangles=torch.from_numpy(scene.triangles), normals=torch.from_numpy(scene.normals), texture=texture,
            texture_index=torch.from_numpy(scene.texture_index).long(),
            light=encode_light(torch.from_numpy(scene.light_strength)),
            environment=self._environment(scene.environment), volumes=volume_inputs(scene.volumes))

    def require_known(self, scene: ProcessedScene) -> None:
        """Raises SceneError for latents of another encoder."""
        channels = scene.texture.shape[1]
        if not scene.is_raw and channels != 5 * self.images.channels:
            raise SceneError(f"the scene's texture latents have {channels} channels, "
                             f"the network reads {5 * self.images.channels}")

    def encoded(self, scene: ProcessedScene) -> ProcessedScene:
        """The scene with an encoded texture, if it was raw."""
        if not scene.is_raw:
            return scene

        def raw(rows: list[int]) -> torch.Tensor:
            return self._raw_of_v1(scene.texture[rows]) if scene.is_v1 else torch.from_numpy(scene.texture[rows])

        kind = b"version 1" if scene.is_v1 else b"raw"
        texture = self._latents([digest(self._identity, kind, tile) for tile in scene.texture], raw)
        return replace(scene, texture=texture.numpy())

    def _environment(self, radiance: np.ndarray | None) -> EnvironmentInputs:
        if radiance is None:
            radiance = np.zeros(ENVIRONMENT_SHAPE, np.float32)
        ldr, hdr, strength = environment_images(radiance)
        key, shape = digest(self._identity, b"environment", radiance), (2, self.images.channels, 32, 64)
        stored = self.store.get([key]).get(key)
        if stored is None:
            with part(1.0, 1.0, "Encoding the environment"):
                stored = self.images(torch.from_numpy(np.stack([ldr, hdr]))).numpy().tobytes()
            self.store.put({key: stored})
        latents = torch.from_numpy(np.frombuffer(stored, np.float32).reshape(shape).copy())
        return EnvironmentInputs(latents[0], latents[1], torch.tensor([strength]))

    def _tile_latents(self, tiles: np.ndarray, own_latents: np.ndarray, lobes: np.ndarray | None) -> np.ndarray:
        """own_latents: (T, 9) appearance in place of the parameters, or 0; lobes: as in RenderScene."""
        def raw(rows: list[int]) -> torch.Tensor:
            parts = material_tiles(torch.from_numpy(tiles[rows]).float().to(self.images.device), self.appearance)
            if lobes is not None and (layered := lobes[rows].any(axis=(1, 2, 3))).any():
                parts[torch.from_numpy(layered), :LATENT_DIM] = self._of_lobes(lobes[rows][layered]).to(parts)
            latent = torch.from_numpy(own_latents[rows]).to(parts)[..., None, None]
            parts[:, :LATENT_DIM] = torch.where(latent.any(1, keepdim=True), latent, parts[:, :LATENT_DIM])
            emission = parts.new_zeros(len(parts), 3, *parts.shape[2:])  # never encoded
            return torch.cat([parts[:, :12], emission, parts[:, 12:]], 1).half().cpu()  # as files store it

        keys = [digest(self._identity, b"material", tile, *([latent] if latent.any() else ()),
                       *([lobes[i]] if lobes is not None and lobes[i].any() else ()))
                for i, (tile, latent) in enumerate(zip(tiles, own_latents, strict=True))]
        return self._latents(keys, raw).numpy()

    def _raw_of_v1(self, tiles: np.ndarray) -> torch.Tensor:
        """(t, 13, q, q) tiles of version 1 -> (t, 16, q, q) raw ones (docs/scene-input.md 4.1), without height."""
        whole = torch.from_numpy(fill_tiles(tiles.astype(np.float32)))
        latent = self._diffuse_specular(whole[:, BRDF].movedim(1, -1)).movedim(-1, 1).to(whole)
        return torch.cat([latent, 2 * whole[:, V1["normal"]] - 1, whole[:, V1["emission"]],
                          torch.zeros_like(whole[:, :1])], 1)

    def _of_lobes(self, lobes: np.ndarray) -> torch.Tensor:
        """(t, 7, q, q) -> (t, 9, q, q) as the research code makes latents of diffuse and specular."""
        return self._diffuse_specular(torch.from_numpy(lobes).float().movedim(1, -1)).movedim(-1, 1)

    def _diffuse_specular(self, parameters: torch.Tensor) -> torch.Tensor:
        """(..., 7) -> (..., 9)."""
        with torch.no_grad():
            return self.appearance.diffuse_specular(parameters.to(self.images.device))

    def _latents(self, keys: list[bytes], raw: Callable[[list[int]], torch.Tensor]) -> torch.Tensor:
        """(T, 80, 4, 4) f16 of tiles by their keys; raw(rows): tiles as in docs/scene-input.md 4.1, each made once."""
        latents = self.store.get(keys)
        new = [i for key, i in {key: i for i, key in enumerate(keys)}.items() if key not in latents]
        for begin in range(0, len(new), CHUNK):
            with part(begin / len(new), min(begin + CHUNK, len(new)) / len(new),
                      f"Encoding textures, {begin} of {len(new)}"):
                report()
                rows = new[begin:begin + CHUNK]
                images = self.images(image_groups(raw(rows)).flatten(0, 1))
                encoded = images.unflatten(0, (-1, 5)).flatten(1, 2).half().numpy()
            fresh = {keys[i]: tile.tobytes() for i, tile in zip(rows, encoded, strict=True)}
            self.store.put(fresh)
            latents |= fresh
        shape = (len(keys), 5 * self.images.channels, 4, 4)
        return torch.from_numpy(np.frombuffer(b"".join(map(latents.get, keys)), np.float16).reshape(shape).copy())


def digest(*parts: bytes | np.ndarray) -> bytes:
    """A hash of contents, shapes and dtypes."""
    result = hashlib.blake2b(digest_size=16)
    for content in parts:
        if isinstance(content, np.ndarray):
            result.update(f"{content.shape}{content.dtype}".encode())
            content = np.ascontiguousarray(content)
        result.update(content)
    return result.digest()


def image_groups(raw: torch.Tensor) -> torch.Tensor:
    """(T, 15 or 16, q, q) raw tiles -> (T, 5, 3, q, q): 3 of the latent, normal, height (docs/scene-input.md 4.5)."""
    height = raw[:, 15:16] if raw.shape[1] == 16 else torch.zeros_like(raw[:, :1])
    return torch.cat([raw[:, :12].unflatten(1, (4, 3)), height[:, None].expand(-1, -1, 3, -1, -1)], 1)
