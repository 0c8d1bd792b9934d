# SPDX-License-Identifier: GPL-3.0-or-later
"""Panoramas: directions, rotation, and the LDR / HDR pair that the network reads (docs/scene-input.md 7)."""
from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

# float32 throughout, and rotations by way of quaternions, as in the official code: near bright texels the last bit of a
# coordinate shows.
SERIES = 2 * torch.finfo(torch.float32).eps ** (1 / 6)  # radians, below which sin(x) / x is a series


@lru_cache(maxsize=4)
def direction_map(height: int, width: int) -> np.ndarray:
    """(height, width, 3) f32 unit world directions of the pixel centres; the centre is +X, the top row +Z."""
    theta = (torch.arange(height, dtype=torch.float32) + 0.5) / height * math.pi
    phi = (0.5 - (torch.arange(width, dtype=torch.float32) + 0.5) / width) * (2 * math.pi)
    theta, phi = torch.meshgrid(theta, phi, indexing="ij")
    directions = torch.stack([theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()], dim=-1)
    return F.normalize(directions, dim=-1).numpy()


def rotation_matrix(degrees: np.ndarray) -> Tensor:
    """(3,) degrees -> (3, 3) f32 Rz Ry Rx, Blender's Euler order XYZ."""
    rx, ry, rz = (_axis_quaternion(axis, angle) for axis, angle in enumerate(
        torch.deg2rad(torch.tensor(np.asarray(degrees), dtype=torch.float32))))
    x, y, z, w = F.normalize(_product(_product(rz, ry), rx), dim=0)
    return torch.stack([
        x * x - y * y - z * z + w * w, 2 * (x * y - z * w), 2 * (x * z + y * w),
        2 * (x * y + z * w), -x * x + y * y - z * z + w * w, 2 * (y * z - x * w),
        2 * (x * z - y * w), 2 * (y * z + x * w), -x * x - y * y + z * z + w * w]).reshape(3, 3)


def _axis_quaternion(axis: int, angle: Tensor) -> Tensor:
    """(4,) x, y, z, w of a turn about a coordinate axis."""
    half, quaternion = angle.abs() / 2, torch.zeros(4)
    sinc = half.sin() / half if half >= SERIES else 1 - half ** 2 / 6 + half ** 4 / 120
    quaternion[axis] = angle * (sinc / 2)
    quaternion[3] = half.cos()
    return quaternion


def _product(a: Tensor, b: Tensor) -> Tensor:
    vector = a[3] * b[:3] + b[3] * a[:3] + torch.linalg.cross(a[:3], b[:3])
    return torch.cat([vector, (a[3] * b[3] - (a[:3] * b[:3]).sum())[None]])


def sample_panorama(image: np.ndarray, directions: Tensor) -> np.ndarray:
    """Bilinear lookup of (H, W, C) radiance along (h, w, 3) unit directions -> (h, w, C) f32.

    The horizontal coordinate wraps; interpolation clamps at the seam and at the poles, as the official sampler does.
    """
    theta, phi = directions[..., 2].clamp(-1, 1).acos(), torch.atan2(directions[..., 1], directions[..., 0])
    u, v = (0.5 - phi / (2 * math.pi)) % 1.0, theta / math.pi
    return sample_bilinear(image, torch.stack([2 * u - 1, 2 * v - 1], dim=-1))


def sample_bilinear(image: np.ndarray, coordinates: Tensor) -> np.ndarray:
    """(H, W, C) image at coordinates (h, w, 2), x and y from -1 to 1 between its edges, clamped -> (h, w, C) f32."""
    pixels = torch.tensor(np.asarray(image, np.float32)).permute(2, 0, 1)
    samples = F.grid_sample(pixels[None], coordinates[None], padding_mode="border", align_corners=False)[0]
    return samples.permute(1, 2, 0).numpy()


def rotate_environment(image: np.ndarray, degrees: np.ndarray, strength: float) -> np.ndarray:
    """World panorama of a Blender world: (H, W, 3 or 4) image through a Mapping rotation, times strength.

    Returns (H, W, 3) f32.
    """
    directions = torch.from_numpy(direction_map(*image.shape[:2])) @ rotation_matrix(degrees).T
    return sample_panorama(image[..., :3], directions) * np.float32(strength)


def environment_images(radiance: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """(H, W, 3) radiance -> LDR and HDR images (3, H, W) f32 in [-1, 1], and the strength scalar."""
    radiance = np.maximum(np.asarray(radiance, np.float32), 0)
    log = np.log10(radiance + 1)
    strength = float(log.max())
    ldr, hdr = np.clip(radiance, 0, 1) * 2 - 1, log / (strength + 1e-8) * 2 - 1
    chw = [np.ascontiguousarray(a.transpose(2, 0, 1), np.float32) for a in (ldr, hdr)]
    return chw[0], chw[1], strength
