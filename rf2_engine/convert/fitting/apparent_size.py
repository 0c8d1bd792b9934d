# SPDX-License-Identifier: GPL-3.0-or-later
"""The size of things as seen from the camera, by which Max Triangles is spent (docs/scene-input.md 2.3)."""
from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ....model.camera import view_rays_at
from ....model.geometry import barycentric
from ....model.scene import View
from ..data.mesh import lengths
from .visible import VisiblePoints

ASIDE = 0.35   # how large what lies TURN aside of the picture looks, against what is in it
TURN = 1.9     # difference between cosines; a sharper fall would bend surfaces too much to simplify them there
NEAR = 1       # percentile of the visible distances; half of it is `near`
MARGIN = 0.15  # of the picture's width, beyond its edges, that counts as visible
RASTER = 33    # rays along either side of a panorama that tell where it looks
AROUND = 0.1   # length of the mean of the rays of a picture that shows all around


@dataclass(eq=False)
class ApparentSize:
    """One eye at `near` or farther from everything it sees."""

    view: View
    near: float  # world units; what is closer counts no more than at that distance

    def __post_init__(self) -> None:
        view = self.view
        self.eye = view.camera_to_world[:3, 3].astype(np.float64)
        if view.panorama is None:
            rays = view_rays_at(view, np.float64([0, view.width]), np.float64([0, view.height]))[1]
        else:
            x, y = np.meshgrid(np.linspace(0, view.width, RASTER), np.linspace(0, view.height, RASTER))
            rays = view_rays_at(view, x, y)[1][view.panorama.visible(x + view.corner[0], y + view.corner[1])]
        middle = rays.mean(axis=0, dtype=np.float64)
        is_around = np.linalg.norm(middle) < AROUND
        self.axis = -view.camera_to_world[:3, 2] if is_around else middle / np.linalg.norm(middle)
        self.cosine = -1.0 if is_around else float((rays @ self.axis).min())  # of the cone around the whole picture

    @property
    def solid_angle(self) -> float:
        """Solid angle of the picture, about, in steradians."""
        pixels = self.view.width * self.view.height
        return min(pixels / abs(float(np.prod(self.view.focal.astype(np.float64)))), 4 * math.pi)

    def distance(self, corners: np.ndarray) -> np.ndarray:
        """(n,) from the eye to the nearest point, about, of each of (n, 3, 3) world triangles; `near` at least."""
        weights = barycentric(corners, np.broadcast_to(self.eye, (len(corners), 3))).clip(0, 1)
        weights /= weights.sum(axis=1, keepdims=True)
        nearest = np.einsum("nk,nkx->nx", weights, corners) - self.eye
        return np.linalg.norm(nearest, axis=1).clip(self.near)

    def is_inside(self, corners: np.ndarray) -> np.ndarray:
        """(n,) bool: no side of the picture, with its margin, has all corners of a (n, 3, 3) world triangle outside."""
        view = self.view
        if view.panorama is not None:
            away = corners - self.eye
            return ~(away @ self.axis < (min(self.cosine, 0) - MARGIN) * np.linalg.norm(away, axis=-1)).all(axis=1)
        x, y, z = np.moveaxis((corners - self.eye) @ view.camera_to_world[:3, :3].astype(np.float64), -1, 0)
        margin = MARGIN * view.longer_side
        x, y = x * view.focal[0], -y * view.focal[1]
        outside = (x < z * (view.principal[0] + margin), x > -z * (view.width - view.principal[0] + margin),
                   y < z * (view.principal[1] + margin), y > -z * (view.height - view.principal[1] + margin), z > 0)
        return ~np.any([side.all(axis=1) for side in outside], axis=0)

    def size(self, corners: np.ndarray, longest: np.ndarray) -> np.ndarray:
        """(n,) about how long edges of length `longest` look, as a fraction of the picture; 0 outside of it."""
        return self.largest(longest) * self.near / self.distance(corners) * self.is_inside(corners)

    def largest(self, longest: np.ndarray) -> np.ndarray:
        """(n,) how long edges of length `longest` look where they look longest."""
        return longest / self.near * float(self.view.focal.max()) / self.view.longer_side

    def drawn_in(self, points: np.ndarray) -> np.ndarray:
        """(n, 3) world points moved to where lengths are as they look from the eye: a space to simplify meshes in.

        Distances from the eye become logarithms, and what lies away from the picture shrinks.
        """
        away = points - self.eye
        far = lengths(away)[:, None] / self.near
        return away / self.near * (np.where(far > 1, (1 + np.log(far.clip(1))) / far.clip(1), 1) * self._weight(away))

    def drawn_out(self, points: np.ndarray) -> np.ndarray:
        """The inverse of `drawn_in`."""
        near = points / self._weight(points)
        far = lengths(near)[:, None]
        return self.eye + near * self.near * np.where(far > 1, np.exp(far.clip(1) - 1) / far.clip(1), 1)

    def _weight(self, away: np.ndarray) -> np.ndarray:
        """(n, 1) 1 in the cone of the picture, falling smoothly to ASIDE around it."""
        cosine = away @ self.axis[:, None] / lengths(away)[:, None].clip(1e-30)
        t = ((self.cosine - cosine) / TURN).clip(0, 1)
        return 1 - (1 - ASIDE) * t * t * (3 - 2 * t)


class ApparentSpace:
    """Moves points from the frame of an object to a space where lengths are as they look from the camera, and back."""

    def __init__(self, matrix: np.ndarray, apparent: ApparentSize):
        """matrix: (4, 4) object to world."""
        self.matrix, self.apparent = matrix, apparent
        self.is_flat = abs(np.linalg.det(matrix[:3, :3])) < 1e-9 * np.linalg.norm(matrix[:3, :3]) ** 3

    def enter(self, points: np.ndarray) -> np.ndarray:
        """(n, 3) points of the object in that space."""
        if self.is_flat:
            return points
        return self.apparent.drawn_in(points @ self.matrix[:3, :3].T + self.matrix[:3, 3])

    def leave(self, points: np.ndarray) -> np.ndarray:
        """The inverse."""
        if self.is_flat:
            return points
        return (self.apparent.drawn_out(points) - self.matrix[:3, 3]) @ np.linalg.inv(self.matrix[:3, :3]).T


def measure_apparent_size(view: View, hits: VisiblePoints) -> ApparentSize:
    """The ApparentSize of a view with these `hits`."""
    distance = np.linalg.norm(hits.points - view.camera_to_world[:3, 3], axis=1)
    return ApparentSize(view, max(float(np.percentile(distance, NEAR)), 1e-6) / 2 if len(hits) else 1.0)
