# SPDX-License-Identifier: GPL-3.0-or-later
"""The light of a clear sky: sun light that air and aerosols scatter once (Nishita et al. 1993), and again by its mean.

Lengths are metres, wavelengths micrometres.
"""
from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from .spectrum import XYZ_TO_REC709, observer

EARTH, TOP = 6.360e6, 6.420e6     # radii
HIGHEST = 5.99e4                  # viewer, as in Blender
AIR, DUST = 8.0e3, 1.2e3          # heights over which they thin out by e
OZONE = 25.0e3, 15.0e3            # height of its layer's middle, and half of its width
RAYLEIGH = 1.24e-6                # 1/m at a wavelength of 1, which it falls with to the fourth
MIE, EXTINCTION = 2.0e-5, 1.11    # 1/m of aerosols, and what they take away besides over that
FORWARD = 0.76                    # mean cosine of what they scatter
WAVES = np.linspace(0.39, 0.71, 17)
# 1/m of ozone in the middle of its layer, of 300 Dobson units (Chappuis absorption).
ABSORBED = 1e-6 * np.interp(WAVES, (0.42, 0.44, 0.48, 0.52, 0.56, 0.58, 0.60, 0.62, 0.66, 0.70, 0.74),
                            (0.0, 0.07, 0.37, 0.95, 2.1, 2.5, 2.75, 2.15, 1.15, 0.45, 0.2))
STEPS, TO_SUN = 32, 16            # along a ray, and from there to the sun
ROWS, COLUMNS = 24, 13            # of a table, by height and by the angle to the sun's side
SUN_KELVIN, SUN_SOLID_ANGLE = 5778.0, 6.5e-5  # the latter less than it is: Blender's sun is dimmer
NEWER_DUST, NEWER_OZONE = 0.75, 1.28  # of Blender's sky that scatters light again, over those of the older one
NEWER_TINT = 0.93, 1.04, 1.04     # which knows four wavelengths
GROUND = 0.08                     # albedo
AGAIN = 1.25                      # of the mean light of the sky, what is scattered more than once


@dataclass(frozen=True)
class Atmosphere:
    """What a Sky Texture knows of the air."""

    elevation: float         # of the sun, radians
    altitude: float = 100.0  # of the viewer
    air: float = 1.0         # density, of usual air
    dust: float = 1.0
    ozone: float = 1.0
    scatters_again: bool = False

    def radiance(self, up: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
        """(..., 3) linear Rec.709 from directions: their z (...), 0 or more, and angles (...) to the sun's side."""
        row = np.sqrt(np.arcsin(up.clip(0, 1)) / (np.pi / 2)) * (ROWS - 1)
        column = np.abs((azimuth + np.pi) % (2 * np.pi) - np.pi) / np.pi * (COLUMNS - 1)
        i, j = (np.minimum(x.astype(int), count - 2) for x, count in ((row, ROWS), (column, COLUMNS)))
        s, t = (row - i)[..., None], (column - j)[..., None]
        table = _table(self)
        return ((1 - s) * ((1 - t) * table[i, j] + t * table[i, j + 1])
                + s * ((1 - t) * table[i + 1, j] + t * table[i + 1, j + 1]))

    def sun_irradiance(self) -> np.ndarray:
        """(3,) linear Rec.709 of the whole sun, on a surface that faces it; 0 below the horizon."""
        return _rgb(self._sun_spectrum())

    def _sun_spectrum(self) -> np.ndarray:
        """(waves,) of the same."""
        metres, is_lit = self._to_sun(self._eye[None])
        return _sun() * np.exp(-self._depth(metres[0])) * is_lit[0]

    @property
    def _eye(self) -> np.ndarray:
        return np.array([0, 0, EARTH + np.clip(self.altitude, 1.0, HIGHEST)])

    @property
    def toward_sun(self) -> np.ndarray:
        return np.array([np.cos(self.elevation), 0, np.sin(self.elevation)])

    def spectra(self, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(D, waves) radiance from unit vectors (D, 3), the sun's side being that of X, that air and dust scatter."""
        point, metres = self._along(direction)
        air, dust, _ = metres.transpose(2, 0, 1)
        to_sun, is_lit = self._to_sun(point.reshape(-1, 3))
        metres = metres.cumsum(1) - (metres / 2 if self.scatters_again else 0)  # Blender's older sky counts whole steps
        depth = self._depth(metres + to_sun.reshape(*point.shape[:2], 3))
        cosine = (direction @ self.toward_sun)[:, None, None]
        by_air = 3 / (16 * np.pi) * (1 + cosine ** 2) * air[..., None] * (RAYLEIGH / WAVES ** 4)
        g = FORWARD
        by_dust = 3 / (8 * np.pi) * (1 - g * g) * (1 + cosine ** 2) / (
            (2 + g * g) * (1 + g * g - 2 * g * cosine) ** 1.5) * dust[..., None] * MIE
        light = _sun() * np.exp(-depth) * is_lit.reshape(*point.shape[:2], 1)
        return (by_air * light).sum(1), (by_dust * light).sum(1)

    def scattered(self, direction: np.ndarray) -> np.ndarray:
        """(D, waves) share of light that is scattered on its way along unit vectors (D, 3), not nearly straight on."""
        metres = self._along(direction)[1].sum(1) * (1, (1 - FORWARD) / EXTINCTION, 0)
        return 1 - np.exp(-self._depth(metres))

    def _along(self, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(D, STEPS, 3) points along unit vectors (D, 3), and densities times metres there."""
        step = _distance_to(TOP, self._eye[None], direction)[:, None, None] / STEPS
        point = self._eye + (np.arange(STEPS) + 0.5)[None, :, None] * step * direction[:, None]
        return point, self._densities(point) * step

    def _densities(self, point: np.ndarray) -> np.ndarray:
        """(..., 3) of air, dust and ozone at points (..., 3), relative."""
        height = np.linalg.norm(point, axis=-1) - EARTH
        middle, half = OZONE
        layer = (1 - np.abs(height - middle) / half).clip(0)
        return np.stack([self.air * np.exp(-height / AIR), self.dust * np.exp(-height / DUST), self.ozone * layer], -1)

    def _to_sun(self, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(P, 3) densities times metres from points (P, 3) to the sun, and (P,) whether the earth is not between."""
        toward = np.broadcast_to(self.toward_sun, point.shape)
        step = _distance_to(TOP, point, toward) / TO_SUN
        along = (np.arange(TO_SUN) + 0.5)[None, :, None] * step[:, None, None] * toward[:, None]
        b = (point * toward).sum(1)
        is_lit = ~((b < 0) & (b ** 2 > (point ** 2).sum(1) - EARTH ** 2))
        return (self._densities(point[:, None] + along) * step[:, None, None]).sum(1), is_lit

    def _depth(self, metres: np.ndarray) -> np.ndarray:
        """(..., waves) optical depth of densities times metres (..., 3)."""
        return metres @ np.stack([RAYLEIGH / WAVES ** 4, np.full_like(WAVES, MIE * EXTINCTION), ABSORBED])


@lru_cache(maxsize=16)
def _table(atmosphere: Atmosphere) -> np.ndarray:
    """(ROWS, COLUMNS, 3) radiance."""
    up = np.sin(np.linspace(0, 1, ROWS) ** 2 * np.pi / 2)[:, None]
    azimuth = np.linspace(0, np.pi, COLUMNS)
    flat = np.sqrt(1 - up ** 2)
    direction = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), up + 0 * azimuth], -1).reshape(-1, 3)
    if not atmosphere.scatters_again:
        return _rgb(sum(atmosphere.spectra(direction))).reshape(ROWS, COLUMNS, 3)
    atmosphere = replace(atmosphere, dust=NEWER_DUST * atmosphere.dust, ozone=NEWER_OZONE * atmosphere.ozone)
    by_air, by_dust = atmosphere.spectra(direction)
    weight = np.gradient(up[:, 0])[:, None].repeat(COLUMNS, 1).reshape(-1, 1)
    mean = (weight * (by_air + (1 - FORWARD) * by_dust)).sum(0) / weight.sum()
    ground = GROUND / np.pi * np.sin(max(atmosphere.elevation, 0)) * atmosphere._sun_spectrum()
    again = AGAIN * (mean + ground) * atmosphere.scattered(direction)
    return NEWER_TINT * _rgb(by_air + by_dust + again).reshape(ROWS, COLUMNS, 3)


def _distance_to(radius: float, point: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """(P,) from points (P, 3) inside of a sphere along unit vectors (P, 3) to it."""
    b = (point * direction).sum(1)
    return np.sqrt(b ** 2 - (point ** 2).sum(1) + radius ** 2) - b


@lru_cache(maxsize=1)
def _sun() -> np.ndarray:
    """(waves,) irradiance of the sun outside of the atmosphere, W/(m^2 nm), as of a black body."""
    metres = WAVES * 1e-6
    radiance = 1.191e-16 / metres ** 5 / np.expm1(1.4388e-2 / (metres * SUN_KELVIN))
    return radiance * 1e-9 * SUN_SOLID_ANGLE


def _rgb(spectra: np.ndarray) -> np.ndarray:
    """(..., 3) linear Rec.709 of (..., waves)."""
    step = (WAVES[1] - WAVES[0]) * 1e3
    return (step * spectra @ observer(WAVES * 1e3).T @ XYZ_TO_REC709.T).clip(0)
