# SPDX-License-Identifier: GPL-3.0-or-later
"""Measured BRDFs in the binary format of the MERL database, and their pictures on a sphere.

Matusik et al. 2003, "A Data-Driven Reflectance Model": isotropic, by the angles of the half vector (Rusinkiewicz 1998).
"""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .. import progress
from ..errors import SceneError
from ..geometry import dot, latlong_directions, unit
from ..pictures import resize

SUFFIXES = ".bsdf", ".binary"                  # of the RGL and the MERL database
SHAPE = 90, 90, 180                            # angles of half vector and difference, azimuth of the difference
SCALE = np.array([1.0, 1.15, 1.66]) / 1500     # of what the files store, by channel
DISTANCE, FIELD_OF_VIEW = 3.0, 39.6            # of the camera (docs/scene-input.md 3.6), degrees
SIDE = 4                                       # samples of a pixel along each axis, by which it is covered
PIXELS = 16                                    # that see the whole panorama at once, a step of progress
LIGHT = 64, 128                                # to which a studio light is reduced


@dataclass(frozen=True)
class MeasuredBRDF:
    table: np.ndarray  # (90, 90, 180, 3) f32 per steradian

    @classmethod
    def load(cls, path: Path) -> MeasuredBRDF:
        """Raises SceneError for a file that is no BRDF of the MERL database."""
        try:
            with open(path, "rb") as file:
                shape = tuple(np.fromfile(file, "<i4", 3))
                values = np.fromfile(file, "<f8")
        except OSError as error:
            raise SceneError(f"{path} cannot be read: {error.strerror}") from error
        if shape != SHAPE or values.size != 3 * np.prod(SHAPE):
            raise SceneError(f"{path} is no binary file of the MERL BRDF database: choose a file such as "
                             "blue-metallic-paint.binary")
        table = values.reshape(3, *SHAPE).transpose(1, 2, 3, 0) * SCALE
        return cls(table.clip(0).astype(np.float32))  # what was not measured is negative

    def save(self, path: Path) -> None:
        with open(path, "wb") as file:
            np.array(SHAPE, "<i4").tofile(file)
            np.ascontiguousarray((self.table / SCALE).transpose(3, 0, 1, 2), "<f8").tofile(file)

    def __call__(self, normal: np.ndarray, incoming: np.ndarray, outgoing: np.ndarray) -> np.ndarray:
        """(..., 3) per steradian, of unit vectors (..., 3) that point away from the surface; 0 below it."""
        half = unit(incoming + outgoing)
        across = unit(np.cross(normal, half))
        along = np.cross(across, half)
        azimuth = np.arctan2(dot(incoming, across), dot(incoming, along)) % np.pi  # reciprocity: half a turn is enough
        half_angle, difference = (np.arccos(dot(a, half).clip(-1, 1)) / (np.pi / 2) for a in (normal, incoming))
        places = (np.sqrt(half_angle) * SHAPE[0], difference * SHAPE[1], azimuth / np.pi * SHAPE[2])
        found = self.table[tuple(place.astype(int).clip(0, size - 1) for place, size in zip(places, SHAPE))]
        above = (dot(normal, incoming) > 0) & (dot(normal, outgoing) > 0)
        return found * above[..., None]


def grey_light(pixels: np.ndarray) -> np.ndarray:
    """(64, 128) f32 for `sphere_picture`: the mean of the colours of a panorama (H, W, 3 or 4), row 0 looking up."""
    return resize(pixels[..., :3].mean(axis=-1, keepdims=True), *LIGHT)[..., 0]


def sphere_picture(brdf, panorama: np.ndarray, size: int) -> np.ndarray:
    """(size, size, 3) f32 linear radiance of a unit sphere under a panorama (H, W), row 0 looking up, as
    tools.datagen.spheres renders it: colour is premultiplied twice.

    brdf: as MeasuredBRDF is called. A sphere sees no light that it has reflected, so this is all. Reports progress.
    """
    height, width = panorama.shape
    directions = latlong_directions(np.arange(height), height, width).reshape(-1, 3).astype(np.float64)
    solid_angle = np.cos(np.pi * ((np.arange(height) + 0.5) / height - 0.5)) * 2 * np.pi**2 / (height * width)
    light = (panorama * solid_angle[:, None]).reshape(-1)
    normals, rays, alpha = _see_sphere(size)
    radiance, hit = np.zeros((size * size, 3)), np.flatnonzero(alpha)
    for pixels in progress.steps(np.split(hit, range(PIXELS, len(hit), PIXELS))):
        pixel, texel = np.nonzero(normals[pixels] @ directions.T > 0)
        normal, incoming = normals[pixels][pixel], directions[texel]
        arriving = dot(normal, incoming) * light[texel]
        leaving = brdf(normal, incoming, -rays[pixels][pixel]) * arriving[:, None]
        radiance[pixels] = np.stack([np.bincount(pixel, channel, len(pixels)) for channel in leaving.T], axis=1)
    return (radiance * alpha[:, None] ** 2).reshape(size, size, 3).astype(np.float32)


def _see_sphere(size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of all pixels, row by row: unit normals and rays (P, 3) f64, the mean of what is seen, and coverage (P,)."""
    places = np.tan(np.radians(FIELD_OF_VIEW) / 2) * ((np.arange(size * SIDE) + 0.5) / (size * SIDE) * 2 - 1)
    y, z = np.meshgrid(places, -places)
    rays, eye = unit(np.stack([-np.ones_like(y), y, z], axis=-1)), np.array([DISTANCE, 0, 0])
    toward = -rays @ eye
    root = toward**2 - (DISTANCE**2 - 1)
    points = (eye + (toward - np.sqrt(root.clip(0)))[..., None] * rays) * (root > 0)[..., None]

    def of_pixels(samples: np.ndarray) -> np.ndarray:
        return samples.reshape(size, SIDE, size, SIDE, -1).mean(axis=(1, 3)).reshape(size * size, -1)

    return unit(of_pixels(points)), unit(of_pixels(rays)), of_pixels(root > 0)[:, 0]
