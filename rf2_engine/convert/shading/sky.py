# SPDX-License-Identifier: GPL-3.0-or-later
"""Sky Texture, which Cycles draws (cycles/world.py): the direction of its sun, and a uniform sky otherwise."""
from __future__ import annotations

import math

import numpy as np

from .node_call import NodeCall

COLOR = np.array([3.3, 3.7, 4.2])        # radiance of Cycles' own sky at noon, about, W/(m^2 sr)
SUN = np.array([140.0, 110.0, 90.0])     # its irradiance, W/m^2
MIN_SUN_RADIUS = math.radians(0.6)       # what the map can resolve
EDGE = math.radians(0.3)                 # width of the disc's border, so that it does not matter where a ray hits


def sky_texture(n: NodeCall):
    node, direction = n.node, n.linked("Vector")
    direction = n.points.direction if direction is None else direction
    if direction is None:
        n.approximated("a Sky Texture works only in the world: grey is used")
        return np.full(3, 0.5, np.float32)
    n.approximated("its Sky Texture is replaced by a uniform sky of about the same brightness")
    # Below the horizon it fades out over 24 degrees as in Cycles.
    radiance = COLOR * np.clip(1 + 2.5 * np.minimum(direction[..., 2:], 0), 0, 1) ** 3
    if is_physical(node) and node.sun_disc:
        radiance = radiance + _disc(direction, sun_direction(node), node.sun_size / 2) * node.sun_intensity
    return radiance.astype(np.float32)


def is_physical(node) -> bool:
    """Whether a Sky Texture scatters the light of a sun, which it may show."""
    return node.sky_type not in ("PREETHAM", "HOSEK_WILKIE")


def sun_direction(node) -> np.ndarray:
    """(3,) unit, where the sun of a Sky Texture stands."""
    if not is_physical(node):
        return np.array(node.sun_direction) / max(np.linalg.norm(node.sun_direction), 1e-6)
    elevation, turn = node.sun_elevation, node.sun_rotation
    return np.array([*np.array([math.sin(turn), math.cos(turn)]) * math.cos(elevation), math.sin(elevation)])


def _disc(direction, sun, radius) -> np.ndarray:
    """(..., 3) radiance of the sun's disc, widened to what the map resolves at the same irradiance."""
    if sun[2] <= -math.sin(radius):
        return np.zeros(3)
    wide = max(radius, MIN_SUN_RADIUS)
    radiance = SUN / (math.pi * (math.sin(wide) ** 2 + EDGE ** 2 / 12))
    away = 2 * np.arcsin(np.minimum(np.linalg.norm(direction - sun, axis=-1) / 2, 1))
    return np.clip((wide - away) / EDGE + 0.5, 0, 1)[..., None] * radiance


FUNCTIONS = {"ShaderNodeTexSky": sky_texture}
