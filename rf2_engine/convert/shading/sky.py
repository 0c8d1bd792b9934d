# SPDX-License-Identifier: GPL-3.0-or-later
"""Sky Texture by single scattering of sunlight in a clear atmosphere (Nishita et al. 1993).

Air, aerosol and ozone thin out with height; sunlight is followed to points along the view ray and scattered once. Ten
wavelengths are gathered into Rec.709 with the observer of spectrum.py. Lengths are metres, radiances W/(m^2 sr).
"""
from __future__ import annotations

import functools
import math

import numpy as np

from ....model import progress
from .node_call import NodeCall
from .spectrum import XYZ_TO_REC709, observer

EARTH, TOP = 6.36e6, 6.42e6
NM = np.linspace(390.0, 750.0, 10)
AIR = 1.24e-6 * (NM / 1000) ** -4.0                         # Rayleigh scattering per metre at sea level
AEROSOL = np.full_like(NM, 2.0e-5)
OZONE = 2.3e-6 * np.exp(-0.5 * ((NM - 590) / 62) ** 2)      # Chappuis band at its densest, 25 km
# Sunlight outside the atmosphere, W/(m^2 nm): a smooth spectrum whose blue end is fitted to Cycles' skies.
SUN = np.array([1.05, 1.40, 1.73, 1.76, 1.75, 1.74, 1.65, 1.53, 1.40, 1.27])
TO_REC709 = XYZ_TO_REC709 @ observer(NM) * (NM[1] - NM[0])  # (3, 10)
FORWARD = 0.76                                              # of aerosol
VIEW_STEPS, SUN_STEPS, ELEVATIONS, AZIMUTHS = 32, 12, 40, 41
LIMB = 0.8                                                  # mean brightness of the darkened disc over its centre
MIN_SUN_RADIUS = math.radians(0.6)                          # what the map can resolve
EDGE = math.radians(0.3)                                    # width of the disc's border, so that no ray's place counts
SCALE = {"PREETHAM": 0.17, "HOSEK_WILKIE": 0.025, "MULTIPLE_SCATTERING": np.array([1.03, 1.34, 1.71])}


def sky_texture(n: NodeCall):
    node, direction = n.node, n.linked("Vector")
    direction = n.points.direction if direction is None else direction
    if direction is None:
        n.approximated("a sky is only evaluated in the world, grey is used")
        return np.full(3, 0.5, np.float32)
    n.approximated("its sky is estimated, as one of single scattering of about its brightness")
    physical, sun = is_physical(node), sun_direction(node)
    aerosol = getattr(node, "aerosol_density", getattr(node, "dust_density", 1.0))
    amount = np.array([node.air_density, aerosol, node.ozone_density]) if physical else np.ones(3)
    height = EARTH + max(node.altitude if physical else 0.0, 1.0)
    radiance = _lookup(_table(tuple(sun), height, tuple(amount)), direction, sun) * SCALE.get(node.sky_type, 1.0)
    if physical and node.sun_disc:
        radiance = radiance + _disc(direction, sun, height, amount, node.sun_size / 2) * node.sun_intensity
    return np.maximum(radiance, 0).astype(np.float32)


def is_physical(node) -> bool:
    """Whether a Sky Texture scatters the light of a sun, which it may show."""
    return node.sky_type not in ("PREETHAM", "HOSEK_WILKIE")


def sun_direction(node) -> np.ndarray:
    """(3,) unit, where the sun of a Sky Texture stands."""
    if not is_physical(node):
        return np.array(node.sun_direction) / max(np.linalg.norm(node.sun_direction), 1e-6)
    elevation, turn = node.sun_elevation, node.sun_rotation
    return np.array([*np.array([math.sin(turn), math.cos(turn)]) * math.cos(elevation), math.sin(elevation)])


def _densities(height):
    """(..., 3) air, aerosol and ozone at a height above the ground, relative to their densest."""
    ozone = np.maximum(1 - np.abs(height - 25e3) / 15e3, 0)
    return np.stack([np.exp(-height / 8e3), np.exp(-height / 1.2e3), ozone], axis=-1)


def _to_top(radius, cosine):
    """Distance from a point at `radius` from the centre of the Earth to the top of the atmosphere."""
    return -radius * cosine + np.sqrt(np.maximum(radius ** 2 * (cosine ** 2 - 1) + TOP ** 2, 0))


def _depth(radius, cosine, amount):
    """(..., 3) amount of air, aerosol and ozone from a point to space; without limit in the Earth's shadow."""
    step = _to_top(radius, cosine) / SUN_STEPS
    t = (np.arange(SUN_STEPS) + 0.5) * step[..., None]
    height = np.sqrt(radius[..., None] ** 2 + t ** 2 + 2 * radius[..., None] * cosine[..., None] * t) - EARTH
    depth = _densities(np.maximum(height, 0)).sum(axis=-2) * step[..., None] * amount
    shadow = (cosine < 0) & (radius * np.sqrt(np.maximum(1 - cosine ** 2, 0)) < EARTH)
    return np.where(shadow[..., None], 1e12, depth)


def _transmitted(depth):
    """(..., 10) share of light left behind amounts (..., 3) of air, aerosol and ozone."""
    return np.exp(-depth @ np.stack([AIR, 1.11 * AEROSOL, OZONE]))


@functools.lru_cache(maxsize=8)
def _table(sun: tuple, height: float, amount: tuple) -> np.ndarray:
    """(ELEVATIONS, AZIMUTHS, 3) radiance from the horizon up and from the sun's azimuth round to the opposite one.

    sun: unit direction; height: of the camera above the centre of the Earth; amount: of air, aerosol and ozone.
    """
    elevation = math.pi / 2 * np.linspace(0.02, 1, ELEVATIONS)[:, None] ** 2
    azimuth = np.linspace(0, math.pi, AZIMUTHS)[None]
    cosine = np.cos(elevation) * math.hypot(sun[0], sun[1]) * np.cos(azimuth) + np.sin(elevation) * sun[2]
    air_phase = 3 / (16 * math.pi) * (1 + cosine ** 2)
    g = FORWARD
    aerosol_phase = (3 / (8 * math.pi) * (1 - g * g) * (1 + cosine ** 2)
                     / ((2 + g * g) * (1 + g * g - 2 * g * cosine) ** 1.5))
    up = np.broadcast_to(np.sin(elevation), cosine.shape)
    step = _to_top(height, up) / VIEW_STEPS
    depth, total = np.zeros(cosine.shape + (3,)), np.zeros(cosine.shape + (len(NM),))
    for i in range(VIEW_STEPS):
        progress.report(0.0, "Computing the sky")
        t = (i + 0.5) * step
        radius = np.sqrt(height ** 2 + t ** 2 + 2 * height * up * t)
        here = _densities(radius - EARTH) * amount
        to_sun = _depth(radius, (height * sun[2] + t * cosine) / radius, amount)
        depth += here * step[..., None]
        light = SUN * _transmitted(depth + to_sun)
        scattered = (here[..., :1] * air_phase[..., None]) * AIR + (here[..., 1:2] * aerosol_phase[..., None]) * AEROSOL
        total += light * scattered * step[..., None]
    return total @ TO_REC709.T


def _lookup(table, direction, sun) -> np.ndarray:
    """(..., 3) bilinear in the table; below the horizon it fades out over 24 degrees as in Cycles."""
    elevation = np.arcsin(np.clip(direction[..., 2], -1, 1))
    azimuth = np.abs(np.arctan2(direction[..., 0], direction[..., 1]) - math.atan2(sun[0], sun[1]))
    azimuth = np.minimum(azimuth, 2 * math.pi - azimuth)
    row = (np.sqrt(np.maximum(elevation, 0) * 2 / math.pi) - 0.02) / 0.98 * (ELEVATIONS - 1)
    row, column = np.clip(row, 0, ELEVATIONS - 1.001), np.clip(azimuth / math.pi * (AZIMUTHS - 1), 0, AZIMUTHS - 1.001)
    r, c = row.astype(int), column.astype(int)
    fr, fc = (row - r)[..., None], (column - c)[..., None]
    low = table[r, c] * (1 - fc) + table[r, c + 1] * fc
    high = table[r + 1, c] * (1 - fc) + table[r + 1, c + 1] * fc
    fade = np.clip(1 + 2.5 * np.minimum(direction[..., 2:], 0), 0, 1) ** 3
    return (low * (1 - fr) + high * fr) * fade


def _disc(direction, sun, height, amount, radius) -> np.ndarray:
    """(..., 3) radiance of the sun's disc, widened to what the map resolves at the same irradiance."""
    if sun[2] <= -math.sin(radius):
        return np.zeros(3)
    wide = max(radius, MIN_SUN_RADIUS)
    left = _transmitted(_depth(np.array(height), np.array(max(sun[2], 0.0)), amount))
    radiance = LIMB * TO_REC709 @ (SUN * left) / (math.pi * (math.sin(wide) ** 2 + EDGE ** 2 / 12))
    away = 2 * np.arcsin(np.minimum(np.linalg.norm(direction - sun, axis=-1) / 2, 1))
    return np.clip((wide - away) / EDGE + 0.5, 0, 1)[..., None] * radiance


FUNCTIONS = {"ShaderNodeTexSky": sky_texture}
