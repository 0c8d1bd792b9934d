# SPDX-License-Identifier: GPL-3.0-or-later
"""Turn suns in a sky or an HDRI into lights, so that networks without traced hints know where shadows fall."""
from __future__ import annotations

import math

import numpy as np

from ....model.clusters import split_clusters
from ....model.geometry import latlong_directions
from ..data.copied import Sun

MAX_SUNS = 4
TRIES = 8                       # bright places that are tried
CORE = math.radians(5)          # radius of the area that a sun lies in
CENTRINGS = 3                   # from its brightest texel to its middle
RING = math.radians(8)          # outer radius of its surroundings
CONTRAST = 8                    # times as bright as most of the ring
SHARE = 0.03                    # of the irradiance of a surface that faces it, beside all else


def split_suns(environment: np.ndarray) -> tuple[np.ndarray, list[Sun]]:
    """A (H, W, 3) panorama without its suns, and the suns; together they give the same irradiance.

    A sun is a small area, much brighter than its surroundings, that gives a good part of the light. It is replaced by
    the brightness of its surroundings.
    """
    if (environment == environment[0, 0]).all():
        return environment, []
    height, width, _ = environment.shape
    towards = latlong_directions(np.arange(height), height, width).astype(np.float64)
    edges = np.cos(np.pi * np.arange(height + 1) / height)
    solid_angle = np.broadcast_to(((edges[:-1] - edges[1:]) * 2 * math.pi / width)[:, None], (height, width))
    remaining, suns, unseen = environment.copy(), [], np.ones((height, width), bool)
    for _ in range(TRIES):
        brightness = remaining.mean(axis=-1) * unseen
        if not brightness.any():
            break
        middle = towards[np.unravel_index(brightness.argmax(), brightness.shape)]
        for _ in range(CENTRINGS):
            core = towards @ middle > math.cos(CORE)
            middle = _unit((brightness * solid_angle)[core] @ towards[core])
        cosine = towards @ middle
        core, ring = cosine > math.cos(CORE), (cosine <= math.cos(CORE)) & (cosine > math.cos(RING))
        if not ring.any():  # light that is too faint to have a middle
            break
        unseen &= ~core
        surroundings = np.median(remaining[ring], axis=0)
        excess = np.maximum(remaining[core] - surroundings, 0) * solid_angle[core, None]
        sun = _sun(excess, towards[core], solid_angle[core])
        if sun is None or not _stands_out(sun, remaining, ring, solid_angle * np.maximum(towards @ sun.toward, 0)):
            continue
        remaining[core] = np.minimum(remaining[core], surroundings)
        suns.append(sun)
        if len(suns) == MAX_SUNS:
            break
    return remaining, suns


def merge_suns(suns: list[Sun], most: int) -> list[Sun]:
    """At most `most` suns, each with the light of all from about its direction on surfaces that face it."""
    toward = np.array([sun.toward for sun in suns])
    light = np.array([sun.irradiance for sun in suns])
    power = light.mean(axis=1)
    merged = []
    kinds = [(sun.reach, sun.light_group) for sun in suns]
    alike = [np.flatnonzero([kind == own for kind in kinds]) for own in dict.fromkeys(kinds)]
    for rows in split_clusters(toward, power, alike, most):
        middle = _unit(power[rows] @ toward[rows])
        merged.append(Sun(middle, (toward[rows] @ middle) @ light[rows], max(suns[i].angle for i in rows),
                          *kinds[rows[0]]))
    return merged


def _sun(light: np.ndarray, towards: np.ndarray, solid_angle: np.ndarray) -> Sun | None:
    """The disc that gives the same light as texels: (n, 3) radiance times solid angle."""
    power = light.mean(axis=1)
    if not power.any():
        return None
    middle = _unit(power @ towards)
    size = power.sum() ** 2 / (power ** 2 / solid_angle).sum()  # of a disc: its solid angle
    return Sun(middle, (towards @ middle) @ light, 2 * math.acos(1 - min(size / (2 * math.pi), 1)))


def _stands_out(sun: Sun, panorama: np.ndarray, ring: np.ndarray, facing: np.ndarray) -> bool:
    """facing: (H, W) solid angles as a surface that faces the sun sees them."""
    irradiance = sun.irradiance.mean()
    radiance = irradiance / (math.pi * math.sin(sun.angle / 2) ** 2)
    surroundings = np.quantile(panorama[ring].mean(axis=-1), 0.9)
    everything = (panorama.mean(axis=-1) * facing).sum()
    return radiance > CONTRAST * surroundings and irradiance > SHARE * everything


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / max(np.linalg.norm(vector), 1e-30)
