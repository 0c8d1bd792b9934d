# SPDX-License-Identifier: GPL-3.0-or-later
"""Measured BRDFs in the format of the RGL material database.

Dupuy and Jakob 2018, "An Adaptive Parameterization for Efficient Material Acquisition and Rendering": reflectance is
tabulated where a distribution of visible normals puts its samples. Isotropic or anisotropic, with tables of RGB.
"""
from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from ..errors import SceneError
from ..geometry import dot, unit

MAGIC = b"tensor_file\0"
TYPES = "", "u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f2", "f4", "f8"  # by the number that a file has for them
TABLES = "phi_i", "theta_i", "ndf", "sigma", "vndf", "rgb"
ISOTROPIC = 2  # azimuths at most of a BRDF that does not depend on them


@dataclass(frozen=True)
class AdaptiveBRDF:
    """Tables by half vector (rows: azimuth, columns: root of the elevation) and direction of the viewer."""

    azimuths: np.ndarray    # (A,), of the viewer
    elevations: np.ndarray  # (E,), likewise, angles to the normal
    normals: np.ndarray     # (Y, X), density of microfacet normals by half vector
    area: np.ndarray        # (Y, X), of microfacets as the viewer's direction, in place of the half vector, sees them
    visible: np.ndarray     # (A, E, Y, X), density of visible normals by half vector
    color: np.ndarray       # (A, E, 3, Y, X), reflectance by the place of the half vector in their distribution

    @classmethod
    def load(cls, path: Path) -> AdaptiveBRDF:
        """Raises SceneError for a file that is none of the database, or one of spectra."""
        try:
            tables = read_tensors(path.read_bytes())
        except OSError as error:
            raise SceneError(f"{path} cannot be read: {error.strerror}") from error
        except (ValueError, IndexError, struct.error, UnicodeDecodeError) as error:
            raise SceneError(f"{path} is no file of the RGL material database, or damaged: download it again"
                             ) from error
        if "spectra" in tables:
            raise SceneError(f"{path} holds spectra: choose the file of the same material that ends with _rgb.bsdf")
        if missing := [name for name in TABLES if name not in tables]:
            raise SceneError(f"{path} is no BRDF of the RGL material database: it has no {', '.join(missing)}")
        return cls(*(tables[name] for name in TABLES))

    def __call__(self, normal: np.ndarray, incoming: np.ndarray, outgoing: np.ndarray) -> np.ndarray:
        """(P, 3) per steradian, of unit vectors (P, 3) that point away from the surface; 0 below it.

        Azimuths count from the direction around the Z axis.
        """
        around = np.cross((0.0, 0.0, 1.0), normal)
        around[np.abs(normal[..., 2]) > 1 - 1e-9] = 1, 0, 0
        frame = np.stack([unit(around), np.cross(normal, unit(around)), normal], -2)
        local = [np.einsum("pij,pj->pi", frame, direction) for direction in (unit(incoming + outgoing), outgoing)]
        (half, turn), (elevation, azimuth) = ((np.arccos(v[:, 2].clip(-1, 1)), np.arctan2(v[:, 1], v[:, 0]))
                                              for v in local)
        is_isotropic = len(self.azimuths) <= ISOTROPIC
        slices = self._slices(0 * azimuth if is_isotropic else azimuth, elevation)
        place = _place(half, turn - azimuth if is_isotropic else turn)
        color = _interpolated(self.color.reshape(-1, *self.color.shape[2:]), self._distributed(place, slices), slices)
        spread = _bilinear(self.normals, place) / (4 * _bilinear(self.area, _place(elevation, azimuth))).clip(1e-12)
        cosine = dot(normal, incoming)
        above = (cosine > 0) & (dot(normal, outgoing) > 0)
        return (color * (spread * above / cosine.clip(1e-6))[:, None]).clip(0)

    def _slices(self, azimuth: np.ndarray, elevation: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Four times the number (P,) of a table among A E, and its weight (P,)."""
        (row, down), (column, right) = (_between(axis, x) for axis, x in (
            (self.azimuths, azimuth), (self.elevations, elevation)))
        count = len(self.elevations)
        return [(np.minimum(row + i, len(self.azimuths) - 1) * count + np.minimum(column + j, count - 1),
                 (down if i else 1 - down) * (right if j else 1 - right)) for i in (0, 1) for j in (0, 1)]

    @cached_property
    def _distribution(self) -> tuple[np.ndarray, ...]:
        """Of all A E tables of visible normals, of integral 1: density, integrals along rows, of rows, and of these."""
        density = self.visible.reshape(-1, *self.visible.shape[2:]).astype(np.float64)
        along = _integral(density)
        total = _integral(along[..., -1])[:, -1]
        density, along = density / total[:, None, None], along / total[:, None, None]
        return density, along, along[..., -1], _integral(along[..., -1])

    def _distributed(self, place: np.ndarray, slices: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        """(P, 2) in the unit square, over which the visible normals at places (P, 2) are distributed evenly."""
        density, along, rows, before = self._distribution
        (x, right), (y, down) = (_cell(place[:, axis], density.shape[2 - axis]) for axis in (0, 1))

        def at(table: np.ndarray, *index: np.ndarray) -> np.ndarray:
            return sum(weight * table[(number, *index)] for number, weight in slices)

        near, far = ((1 - down) * at(density, y, x + i) + down * at(density, y + 1, x + i) for i in (0, 1))
        left = (1 - down) * at(along, y, x) + down * at(along, y + 1, x)
        low, high = at(rows, y), at(rows, y + 1)
        inside = left + right * (near + right * (far - near) / 2)
        return np.stack([inside / ((1 - down) * low + down * high).clip(1e-12),
                         at(before, y) + down * (low + down * (high - low) / 2)], -1)


def read_tensors(data: bytes) -> dict[str, np.ndarray]:
    """All tensors of a file by name. Raises ValueError, IndexError, UnicodeDecodeError or struct.error."""
    if not data.startswith(MAGIC):
        raise ValueError("no tensor file")
    (count,), at, tensors = struct.unpack_from("<I", data, 14), 18, {}
    for _ in range(count):
        (length,) = struct.unpack_from("<H", data, at)
        name, at = data[at + 2:at + 2 + length].decode(), at + 2 + length
        axes, kind, offset = struct.unpack_from("<HBQ", data, at)
        shape, at = struct.unpack_from(f"<{axes}Q", data, at + 11), at + 11 + 8 * axes
        tensors[name] = np.frombuffer(data, "<" + TYPES[kind], int(np.prod(shape)), offset).reshape(shape)
    return tensors


def _place(elevation: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """(P, 2) column and row, from 0 to 1, of angles (P,)."""
    return np.stack([np.sqrt(elevation * 2 / np.pi).clip(0, 1), (azimuth / (2 * np.pi) + 0.5) % 1], -1)


def _between(axis: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Number of the last of the ascending values up to each x, and how far x is from it to the next."""
    at = (np.searchsorted(axis, x, "right") - 1).clip(0, max(len(axis) - 2, 0))
    following = np.minimum(at + 1, len(axis) - 1)
    return at, ((x - axis[at]) / (axis[following] - axis[at]).clip(1e-12)).clip(0, 1) * (following > at)


def _cell(x: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Of places from 0 to 1: number of the first of two of `size` values around them, and the weight of the other."""
    at = (x * (size - 1)).astype(int).clip(0, size - 2)
    return at, x * (size - 1) - at


def _bilinear(table: np.ndarray, place: np.ndarray) -> np.ndarray:
    """(..., Y, X) at places (P, 2) -> (..., P)."""
    return sum(table[..., y, x] * share for y, x, share in _corners(place, table))


def _corners(place: np.ndarray, table: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Rows, columns and shares, (P,) each, of the four values around places (P, 2) of a table (..., Y, X)."""
    (x, right), (y, down) = (_cell(place[:, axis], table.shape[-1 - axis]) for axis in (0, 1))
    return [(y + i, x + j, (down if i else 1 - down) * (right if j else 1 - right)) for i in (0, 1) for j in (0, 1)]


def _interpolated(tables: np.ndarray, place: np.ndarray, slices: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """(A E, 3, Y, X) at places (P, 2) of the weighted slices -> (P, 3)."""
    return sum(tables[number, :, y, x] * (weight * share)[:, None] for number, weight in slices
               for y, x, share in _corners(place, tables))


def _integral(values: np.ndarray) -> np.ndarray:
    """Trapezoids along the last axis, as many as there are values, from 0 on; values are 1 apart."""
    steps = np.cumsum((values[..., 1:] + values[..., :-1]) / 2, -1)
    return np.concatenate([np.zeros_like(values[..., :1]), steps], -1)
