# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays from a camera to the surfaces that it sees, and guides from these alone."""
from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..camera import clip_distances, view_rays, view_rays_at
from ..geometry import corner_weights
from ..progress import part
from ..rays import Hits
from ..scene import Guides, RenderScene, View
from ..scene_rays import scene_rays
from ..shading import emission_share, on_tokens, shading_normals
from ..surface_kinds import SEEN, Ray
from . import glass_from_inside
from .at_pixels import Materials
from .from_rays import AccumulatedGuides, lobe_colors

SAMPLES = 16        # of a pixel
BLACKMAN_HARRIS = 0.35875, 0.48829, 0.14128, 0.01168  # terms of Cycles' default pixel filter
BATCH = 1 << 16     # pixels that are sampled at a time
FILTER_WIDTH = 3.0  # pixels, of the same: Cycles doubles the 1.5 of its setting
FINDING = "Finding visible surfaces"
CENTER = ((0.5, 0.5),)
# Positions in a pixel, no two in a row or column.
SPREAD = ((0.375, 0.125), (0.875, 0.375), (0.625, 0.875), (0.125, 0.625))


class Samples(NamedTuple):
    """First hits of K rays through each of E pixels; 0 where nothing is hit."""

    token: np.ndarray     # (E, K) i32, the token triangle that stands for the surface; -1 = nothing is hit
    position: np.ndarray  # (E, K, 3) f32
    normal: np.ndarray    # (E, K, 3) f32, unit
    colors: np.ndarray    # (3, E, K, 3) f32, albedo of the lobes


class CameraRays:
    """From the camera of a view of a scene; both are in the same frame and units."""

    def __init__(self, scene: RenderScene, view: View):
        self._scene, self._view, self._eye = scene, view, view.camera_to_world[:3, 3]
        self._rays = scene_rays(scene).among(SEEN, Ray.CAMERA)

    def closest(self, direction: np.ndarray) -> Hits:
        """The first hits along directions (P, 3), with triangles by their row in the geometry."""
        if not self._view.clip_start:
            return self._rays.closest(self._eye, direction)
        start = clip_distances(self._view, direction)
        hits = self._rays.closest(self._eye + start[:, None] * direction, direction)
        return hits._replace(distance=hits.distance + start)

    def hits_lie_at(self, points: np.ndarray, tolerance: float) -> np.ndarray:
        """(P,) bool: whether the first hit towards points (P, 3) is there, within a share of the distance."""
        return np.abs(self.closest(points - self._eye).distance - 1) <= tolerance

    def sample(self, pixel: np.ndarray) -> Samples:
        """K rays through pixels by number (E,), row by row, at SAMPLE_POINTS."""
        rays, hits = self._through(pixel, SAMPLE_POINTS)
        hit = hits.triangle >= 0
        triangle, weights = hits.triangle[hit], hits.weights[hit]
        token = np.full(len(rays), -1, np.int32)
        token[hit], on_token = on_tokens(self._scene, triangle, weights)
        values = np.zeros((5, len(rays), 3), np.float32)
        values[0, hit] = hits.distance[hit, None] * rays[hit] + self._eye
        values[1, hit] = shading_normals(self._scene, triangle, corner_weights(weights), rays[hit])
        values[2:, hit] = lobe_colors(self._scene, token[hit], on_token)
        position, normal, *colors = values.reshape(5, len(pixel), len(SAMPLE_POINTS), 3)
        return Samples(token.reshape(position.shape[:2]), position, normal, np.stack(colors))

    def emission(self, pixel: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
        """(E, 3) mean radiance of emitters that `count` rays through each of the pixels (E,) meet, a power of two.

        And the share (E,) of rays that meet any, or what is dark of a picture that shines.
        """
        scene, points, means = self._scene, sample_points(count), np.zeros((len(pixel), 4), np.float32)
        radiance = scene.emission + scene.surface_glow
        table = np.pad(np.column_stack([radiance, radiance.any(axis=1)]), ((0, 1), (0, 0)))  # the last row: nothing
        token = np.append(scene.surfaces.token, -1)
        for rows in np.array_split(np.arange(len(pixel)), len(pixel) * count // (BATCH * SAMPLES) + 1):
            rays, hits = self._through(pixel[rows], points)
            values = table[token[hits.triangle]]
            shines = np.flatnonzero(values[:, 3])
            values[shines, :3] *= emission_share(
                scene, hits.triangle[shines], hits.distance[shines, None] * rays[shines] + self._eye)
            means[rows] = values.reshape(-1, count, 4).mean(1)
        return means[:, :3], means[:, 3]

    def _through(self, pixel: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, Hits]:
        """Rays (E K, 3) through pixels (E,) at `points` (K, 2), and what they hit."""
        row, column = np.divmod(pixel[:, None], self._view.width)
        rays = view_rays_at(self._view, column + points[:, 0], row + points[:, 1])[1].reshape(-1, 3)
        return rays, self.closest(rays)

    def sample_batches(self, pixel: np.ndarray, size: int = BATCH) -> Iterator[tuple[np.ndarray, Samples]]:
        """Samples of up to so many pixels of `pixel` (E,) at a time, and which of the E they are."""
        for rows in np.array_split(np.arange(len(pixel)), len(pixel) // size + 1):
            yield rows, self.sample(pixel[rows])


def cast_guides(scene: RenderScene, view: View, positions: Sequence[tuple[float, float]] = CENTER,
                materials: Materials | None = None) -> Guides:
    """First-hit guides of one view of `scene` (world frame) by rays through these positions in each pixel.

    For pictures without passes of Cycles, such as a viewport's. Without `materials` they are as the tokens' tiles show
    them.
    """
    camera, guides = CameraRays(scene, view), AccumulatedGuides(scene, view, materials)
    for i, position in enumerate(positions):
        rays = view_rays(replace(view, principal=view.principal - np.subtract(position, 0.5)))[1]
        with part(i / len(positions), (i + 1) / len(positions), FINDING):
            hits = camera.closest(rays.reshape(-1, 3))
            guides.add(rays, hits.triangle, hits.weights)
    return glass_from_inside.with_reflectance(guides.guides(), scene, view)


def sample_points(count: int) -> np.ndarray:
    """(count, 2) x and y in a pixel and beyond, distributed like the filter; count is a power of two."""
    t = np.linspace(0, 1, 1025)
    signed = zip(BLACKMAN_HARRIS, (1, -1, 1, -1), strict=True)
    density = sum(sign * term * np.cos(2 * np.pi * k * t) for k, (term, sign) in enumerate(signed))
    reversed_bits = [int(f"{i:b}".zfill(count.bit_length() - 1)[::-1], 2) for i in range(count)]
    uniform = (np.stack([np.arange(count), reversed_bits], 1) + 0.5) / count  # Hammersley's points
    return 0.5 + FILTER_WIDTH * (np.interp(uniform, np.cumsum(density) / density.sum(), t) - 0.5)


SAMPLE_POINTS = sample_points(SAMPLES)
