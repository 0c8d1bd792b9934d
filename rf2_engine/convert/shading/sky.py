# SPDX-License-Identifier: GPL-3.0-or-later
"""Sky Texture where Cycles does not draw it (cycles/world.py), as in viewports, and the direction of its sun."""
from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from .atmosphere import Atmosphere
from .node_call import NodeCall
from .preetham import preetham_sky

HOSEK_WILKIE = 0.16                      # brightness of its sky over that of Preetham's, about
BELOW = {False: 2.5, True: 5.0}          # how fast the sky ends below the horizon, by whether it scatters light again
DISC = {False: 0.84, True: 0.97}         # irradiance of the sun over what comes through the air, likewise
MIN_SUN_RADIUS = math.radians(0.6)       # what the map can resolve
EDGE = math.radians(0.3)                 # width of the disc's border, so that it does not matter where a ray hits


def sky_texture(n: NodeCall):
    node, direction = n.node, n.linked("Vector")
    direction = n.points.direction if direction is None else direction
    if direction is None:
        n.approximated("a Sky Texture works only in the world: grey is used")
        return np.full(3, 0.5, np.float32)
    n.approximated("its Sky Texture is evaluated by other formulas than Cycles'")
    sun = sun_direction(node)
    if not is_physical(node):
        turbidity, brightness = node.turbidity, 1.0 if node.sky_type == "PREETHAM" else HOSEK_WILKIE
        return (brightness * preetham_sky(direction, sun, turbidity)).astype(np.float32)
    air, up = _atmosphere(node), direction[..., 2]
    azimuth = np.arctan2(direction[..., 0], direction[..., 1]) - node.sun_rotation
    fading = np.clip(1 + BELOW[air.scatters_again] * np.minimum(up, 0), 0, 1) ** 3
    radiance = air.radiance(up, azimuth) * fading[..., None]
    if node.sun_disc:
        radiance = radiance + _disc(direction, sun, node.sun_size / 2, _irradiance(air)) * node.sun_intensity
    return radiance.astype(np.float32)


def _atmosphere(node) -> Atmosphere:
    dust = node.aerosol_density if hasattr(node, "aerosol_density") else node.dust_density  # the latter before 5.0
    return Atmosphere(node.sun_elevation, node.altitude, node.air_density, dust, node.ozone_density,
                      node.sky_type == "MULTIPLE_SCATTERING")


def _irradiance(air: Atmosphere) -> np.ndarray:
    """(3,) of the sun, W/m^2; Blender's older model has no ozone before it."""
    air = air if air.scatters_again else replace(air, ozone=0.0)
    return DISC[air.scatters_again] * air.sun_irradiance()


def is_physical(node) -> bool:
    """Whether a Sky Texture scatters the light of a sun, which it may show."""
    return node.sky_type not in ("PREETHAM", "HOSEK_WILKIE")


def sun_direction(node) -> np.ndarray:
    """(3,) unit, where the sun of a Sky Texture stands."""
    if not is_physical(node):
        return np.array(node.sun_direction) / max(np.linalg.norm(node.sun_direction), 1e-6)
    elevation, turn = node.sun_elevation, node.sun_rotation
    return np.array([*np.array([math.sin(turn), math.cos(turn)]) * math.cos(elevation), math.sin(elevation)])


def _disc(direction: np.ndarray, sun: np.ndarray, radius: float, irradiance: np.ndarray) -> np.ndarray:
    """(..., 3) radiance of the sun's disc, widened to what the map resolves at the same irradiance."""
    if sun[2] <= -math.sin(radius):
        return np.zeros(3)
    wide = max(radius, MIN_SUN_RADIUS)
    radiance = irradiance / (math.pi * (math.sin(wide) ** 2 + EDGE ** 2 / 12))
    away = 2 * np.arcsin(np.minimum(np.linalg.norm(direction - sun, axis=-1) / 2, 1))
    return np.clip((wide - away) / EDGE + 0.5, 0, 1)[..., None] * radiance


FUNCTIONS = {"ShaderNodeTexSky": sky_texture}
