# SPDX-License-Identifier: GPL-3.0-or-later
"""ProcessedScene: a scene for the published network, its textures being latents (docs/scene-input.md 0)."""
from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import SceneError
from ..scene import View, Volumes
from .v1_textures import V1

RAW_CHANNELS = (16, 15)  # with and without height (docs/scene-input.md 4.1)


@dataclass
class ProcessedScene:
    """N triangles that share T textures, an environment, M volume cells, V square views; in network units and exposure.

    A scene read from a file may have a raw texture, (T, 15 or 16, q, q) of docs/scene-input.md 4.1, or (T, 13, q, q) of
    version 1 (v1_textures.py).
    """

    triangles: np.ndarray       # (N, 3, 3) f32
    normals: np.ndarray         # (N, 3, 3) f32, unit
    texture: np.ndarray         # (T, 80, 4, 4) f16 latents
    texture_index: np.ndarray   # (N,) i64, row of `texture`
    light_strength: np.ndarray  # (N, 3) f32, radiance
    environment: np.ndarray | None = None  # (256, 512, 3) f32, radiance, rotation and strength applied
    volumes: Volumes | None = None
    camera_to_world: np.ndarray = field(default_factory=lambda: np.zeros((0, 4, 4), np.float32))  # (V, 4, 4) f32
    fov: np.ndarray = field(default_factory=lambda: np.zeros(0, np.float32))                      # (V,) f32, degrees
    image: np.ndarray | None = None        # (V, R, R, 3 or 4) f16, reference picture, linear, premultiplied
    metadata: dict = field(default_factory=dict)

    @property
    def is_raw(self) -> bool:
        """The texture is not encoded yet."""
        return self.is_v1 or self.texture.shape[1] in RAW_CHANNELS

    @property
    def is_v1(self) -> bool:
        """The texture is of a scene of version 1."""
        return self.texture.shape[1] == len(V1)

    def first_view(self) -> ProcessedScene:
        """The scene with the first of its views alone."""
        return replace(self, camera_to_world=self.camera_to_world[:1], fov=self.fov[:1],
                       image=None if self.image is None else self.image[:1])


def square_fov(view: View) -> float:
    """Degrees that the longer side of a view covers: the field of view of the square picture around it.

    Raises SceneError for a view that no square picture around the optical axis contains as its centre.
    """
    shift = np.abs(view.principal - np.array([view.width, view.height]) / 2).max()
    if view.panorama is not None:
        raise SceneError("the camera cannot be exported: panoramas have no place in the file, set its Type to "
                         "Perspective")
    if shift > 0.5 or abs(view.focal[0] / view.focal[1] - 1) > 1e-3:
        raise SceneError("the camera cannot be exported: lens shift, render border and a pixel aspect other than 1 "
                         "have no place in the file, remove them")
    return float(np.degrees(2 * np.arctan(max(view.width, view.height) / 2 / view.focal[0])))
