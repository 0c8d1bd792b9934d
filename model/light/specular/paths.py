# SPDX-License-Identifier: GPL-3.0-or-later
"""Specular paths on their way past mirrors and glass, what they meet, and where they end."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .glass import Cast
from .path_lobes import Lobe

SURFACES = 6       # a path passes at most
SHARP, BLURRED = 0.15, 0.35  # roughness up to which a reflection is an image, and from which it is a mean over the lobe

Media = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


class Casts(NamedTuple):
    """What paths meet, each a function from origins and unit directions (S, 3), such as `Rays.closest`, to the nearest
    triangles (S,) i32, -1 for none, and their distances (S,)."""

    everything: Cast
    solid: Cast | None = None  # everything but glass, so that paths end at what glass touches
    glass: Cast | None = None  # glass alone, where something may lie in one plane with it


@dataclass
class PathEnds:
    """Where P specular paths end: at matte or rough surfaces, lamps, or the sky."""

    position: np.ndarray  # (P, 3) f32, world
    normal: np.ndarray    # (P, 3) f32, unit, facing the path
    share: np.ndarray     # (P, 3) f32, of the light of its diffuse lobe that the path shows; 0 = no surface
    albedo: np.ndarray    # (P, 3) f32, of that lobe
    triangle: np.ndarray  # (P,) i32, of the geometry, that has this albedo; -1 = none has
    light: np.ndarray     # (P, 3) f32, radiance of the lamp or the sky there times the tint of the path
    lobe: Lobe            # of what the paths meet first, if that is metal, or rough glass that they leave
    other: Lobe           # of the layer on what reflections meet first; of what leaves glass after one more reflection
    gloss: Lobe           # of the first metal that is met later than that, and else of the layer on what paths end at

    @classmethod
    def none(cls, count: int) -> PathEnds:
        """Those of so many paths, which show nothing yet."""
        position, normal, share, albedo, light = (np.zeros((count, 3), np.float32) for _ in range(5))
        return cls(position, normal, share, albedo, np.full(count, -1, np.int32), light,
                   *(Lobe.none(count) for _ in range(3)))

    @classmethod
    def joined(cls, parts: list[PathEnds]) -> PathEnds:
        """Those of some paths, then of others."""
        return cls(*(Lobe.joined(values) if isinstance(values[0], Lobe) else np.concatenate(values)
                     for values in zip(*(vars(part).values() for part in parts), strict=True)))

    def scale(self, factor: np.ndarray) -> None:
        """All that paths show becomes so many times (P, 1 or 3) as bright."""
        for color in (self.share, self.light, self.lobe.color, self.other.color, self.gloss.color):
            color *= factor


class Sheets(NamedTuple):
    """Half-transparent surfaces on the way of P paths."""

    clear: np.ndarray     # (T, 3) of first_hits.sheets.sheet_tiles
    straight: np.ndarray  # (P,) bool, paths that begin on one, as they came
    seen: Cast            # of what the camera sees, which these meet


@dataclass
class Paths:
    """S of the paths, that go on."""

    row: np.ndarray        # (S,) of all paths
    origin: np.ndarray     # (S, 3)
    direction: np.ndarray  # (S, 3) unit
    before: np.ndarray     # (S, 3) on the segment before, right before the surface at which that ends
    tint: np.ndarray       # (S, 3) share of what they show that is seen
    reach: np.ndarray      # (S,) the longest segment so far: precision depends on it
    ray: np.ndarray        # (S,) u8, of Ray
    entry: np.ndarray      # (S, 3) normals where they have entered glass, 0 outside
    is_straight: np.ndarray  # (S,) bool, have met nothing but half-transparent surfaces
    shows_lamps: np.ndarray  # (S,) bool, no lobe does that instead
    start: np.ndarray | None  # (S, 2) of `pixel_starts`

    def among(self, chosen: np.ndarray) -> Paths:
        return Paths(*(None if values is None else values[chosen] for values in vars(self).values()))


class Hits(NamedTuple):
    """What S paths meet."""

    triangle: np.ndarray  # (S,) i32, -1 for none
    distance: np.ndarray  # (S,)
    is_dark: np.ndarray   # (S,) bool, in one plane with glass

    def among(self, chosen: np.ndarray) -> Hits:
        return Hits(*(values[chosen] for values in self))


def blur(roughness):
    """0 to 1 (array or tensor): how much a reflection is a mean over the lobe instead of an image."""
    x = ((roughness - SHARP) / (BLURRED - SHARP)).clip(0, 1)
    return x * x * (3 - 2 * x)
