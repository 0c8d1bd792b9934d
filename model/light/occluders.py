# SPDX-License-Identifier: GPL-3.0-or-later
"""Which triangles of a scene block light, let it pass, or bend it, and rays against them for tensors."""
from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ..rays import Rays
from ..scene import BASE_COLOR, IOR, METALLIC, TRANSMISSION, RenderScene

BLACK = 1e-3         # base colour up to which a surface that no camera sees is the back of a lamp
TRANSPARENT = 0.5    # transmission from which on light passes
STRAIGHT = 1.05      # ior up to which light passes without a bend


def passes_light(scene: RenderScene, straight: bool = False) -> np.ndarray:
    """(N,) bool: glass and cut-outs by alpha; with `straight` only what does not bend light, such as cut-outs."""
    transmission, ior, metallic = scene.tiles[:, (TRANSMISSION, IOR, METALLIC)].mean(axis=(2, 3), dtype=np.float32).T
    passes = transmission * (1 - metallic) > TRANSPARENT
    if straight:
        passes &= ior < STRAIGHT
    return passes[scene.tile_index]


def bends_light(scene: RenderScene) -> np.ndarray:
    """(N,) bool: glass."""
    return passes_light(scene) & ~passes_light(scene, straight=True)


def is_solid(scene: RenderScene) -> np.ndarray:
    """(N,) bool: surfaces of the scene, without lamps and their black backs, which are tokens only."""
    black = scene.tiles[:, BASE_COLOR].max(axis=(1, 2, 3)) < BLACK
    return scene.is_seen | ~scene.is_light & ~black[scene.tile_index]


class TensorRays:
    """Rays against triangles (T, 3, 3), in the units that these have."""

    def __init__(self, triangles: np.ndarray):
        self.rays = Rays(triangles)

    def nearest(self, origin: Tensor, direction: Tensor) -> tuple[Tensor, Tensor]:
        """First hits from points (P, 3) along unit vectors (P, 3).

        Returns the triangle (P,) i64, -1 where nothing is hit, and the distance (P,), infinite there.
        """
        hits = self.rays.closest(_to_numpy(origin), _to_numpy(direction))
        return (torch.from_numpy(hits.triangle).to(origin.device, torch.long),
                torch.from_numpy(hits.distance).to(origin.device))

    def is_blocked(self, origin: Tensor, direction: Tensor, distance: Tensor | float = float("inf")) -> Tensor:
        """(P,) bool: whether a triangle is hit within `distance` (P,) of points (P, 3) along unit vectors (P, 3)."""
        limit = _to_numpy(distance) if isinstance(distance, Tensor) else distance
        return torch.from_numpy(self.rays.blocked(_to_numpy(origin), _to_numpy(direction), limit)).to(origin.device)


def _to_numpy(x: Tensor) -> np.ndarray:
    return x.detach().cpu().numpy()
