# SPDX-License-Identifier: GPL-3.0-or-later
"""Panoramas: directions, rotation, and the LDR / HDR pair that the network reads (spec/scene-input.md 7)."""
from __future__ import annotations

from functools import lru_cache

import numpy as np


@lru_cache(maxsize=4)
def direction_map(height: int, width: int) -> np.ndarray:
    """(height, width, 3) f32 unit world directions of the pixel centres; the centre is +X, the top row +Z."""
    import torch  # here, because the engine reads panoramas before it needs the network

    # float32 throughout: the published weights saw these roundings.
    theta = (torch.arange(height, dtype=torch.float32) + 0.5) / height * np.pi
    phi = (0.5 - (torch.arange(width, dtype=torch.float32) + 0.5) / width) * (2 * np.pi)
    theta, phi = torch.meshgrid(theta, phi, indexing="ij")
    directions = torch.stack([theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()], dim=-1)
    return torch.nn.functional.normalize(directions, dim=-1).numpy()


def rotation_matrix(euler: np.ndarray) -> np.ndarray:
    """(3,) radians -> (3, 3) Rz Ry Rx, Blender's Euler order XYZ."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(euler), np.sin(euler)
    rx = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    ry = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    rz = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return rz @ ry @ rx


def sample_panorama(image: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Bilinear lookup of (H, W, C) radiance along (..., 3) unit directions.

    The horizontal coordinate wraps; interpolation clamps at the seam and at the poles, as the official sampler does.
    """
    height, width = image.shape[:2]
    theta = np.arccos(np.clip(directions[..., 2], -1, 1))
    phi = np.arctan2(directions[..., 1], directions[..., 0])
    x = ((0.5 - phi / (2 * np.pi)) % 1.0) * width - 0.5
    y = theta / np.pi * height - 0.5
    return sample_bilinear(image, x, y)


def sample_bilinear(image: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(H, W, C) at pixel coordinates x, y of any shape (0 = centre of the first pixel), clamped to the border."""
    height, width = image.shape[:2]
    x, y = np.clip(x, 0, width - 1), np.clip(y, 0, height - 1)
    x0, y0 = np.minimum(x.astype(int), max(width - 2, 0)), np.minimum(y.astype(int), max(height - 2, 0))
    x1, y1 = np.minimum(x0 + 1, width - 1), np.minimum(y0 + 1, height - 1)
    fx, fy = (x - x0)[..., None], (y - y0)[..., None]
    top = image[y0, x0] * (1 - fx) + image[y0, x1] * fx
    bottom = image[y1, x0] * (1 - fx) + image[y1, x1] * fx
    return top * (1 - fy) + bottom * fy


def rotate_environment(image: np.ndarray, euler: np.ndarray, strength: float) -> np.ndarray:
    """World panorama of a Blender world: (H, W, 3 or 4) image through a Mapping rotation (radians), times strength.

    Returns (H, W, 3) f32.
    """
    image = np.asarray(image, np.float64)[..., :3]
    directions = direction_map(*image.shape[:2]).astype(np.float64) @ rotation_matrix(np.asarray(euler, np.float64)).T
    return (strength * sample_panorama(image, directions)).astype(np.float32)


def environment_images(radiance: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """(H, W, 3) radiance -> LDR and HDR images (3, H, W) f32 in [-1, 1], and the strength scalar."""
    radiance = np.maximum(np.asarray(radiance, np.float32), 0)
    log = np.log10(radiance + 1)
    strength = float(log.max())
    ldr, hdr = np.clip(radiance, 0, 1) * 2 - 1, log / (strength + 1e-8) * 2 - 1
    chw = [np.ascontiguousarray(a.transpose(2, 0, 1), np.float32) for a in (ldr, hdr)]
    return chw[0], chw[1], strength
