# SPDX-License-Identifier: GPL-3.0-or-later
"""What a sample holds, as far as a curriculum asks, read from its file without making anything of it."""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

GLASS = 0.01     # of a pixel's colour
EVEN = 1 / 256   # by how much the parameters of a homogeneous tile may differ


@dataclass(frozen=True)
class Facts:
    triangles: int
    width: int
    height: int
    views: int
    textures: bool      # parameters that vary within a triangle
    environment: bool   # light from the world
    volumes: bool
    transmission: bool  # glass that a view sees


def facts(path: Path) -> Facts:
    """Raises whatever the damage of a damaged file leads to."""
    with np.load(path) as file:
        tiles, names = file["scene.tiles"], set(file.files)
        return Facts(
            triangles=len(file["scene.tile_index"]), width=int(file["view.width"][0]),
            height=int(file["view.height"][0]), views=len(file["view.width"]),
            textures=bool((np.ptp(tiles, axis=(2, 3)) > EVEN).any()),
            environment="scene.environment" in names and bool((file["scene.environment"] > 0).any()),
            volumes="volumes.density" in names, transmission=bool((file["guides.transmission_color"] > GLASS).any()))
