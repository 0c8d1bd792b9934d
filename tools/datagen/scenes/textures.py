# SPDX-License-Identifier: GPL-3.0-or-later
"""Images: procedural maps for textured materials (noise, checker, bricks, stripes and dots), and panoramas."""
from __future__ import annotations

import bpy
import numpy as np

from renderformer_v2.model.pictures import linear_to_srgb

SIZE = 128
PATTERNS = ("noise", "checker", "bricks", "stripes", "dots")


def make_pattern(rng: np.random.Generator) -> np.ndarray:
    """(SIZE, SIZE) f32 in [0, 1], periodic, row 0 at V = 0."""
    kind = str(rng.choice(PATTERNS))
    v, u = np.mgrid[:SIZE, :SIZE].astype(np.float32) / SIZE
    cells = int(rng.integers(2, 9))
    if kind == "noise":
        value = make_noise(rng, cells)
    elif kind == "checker":
        value = ((u * cells).astype(int) + (v * cells).astype(int)) % 2
    elif kind == "bricks":
        row = (v * 2 * cells).astype(int)
        x, y = (u * cells + 0.5 * (row % 2)) % 1, (v * 2 * cells) % 1
        mortar = (x < 0.08) | (y < 0.15)
        value = np.where(mortar, 0.0, 0.6 + 0.4 * make_noise(rng, cells))
    elif kind == "stripes":
        turns = rng.integers(0, 5, 2) + (0, 1)
        value = 0.5 + 0.5 * np.sin(2 * np.pi * (u * turns[0] + v * turns[1] + 0.3 * rng.uniform() * make_noise(rng, 3)))
    else:
        x, y = (u * cells) % 1 - 0.5, (v * cells) % 1 - 0.5
        value = (np.hypot(x, y) < rng.uniform(0.2, 0.45))
    mixed = value + rng.uniform(0, 0.4) * (make_noise(rng, 4) - 0.5)
    return mixed.clip(0, 1).astype(np.float32)


def make_noise(rng: np.random.Generator, cells: int) -> np.ndarray:
    """Periodic fractal value noise, three octaves, (SIZE, SIZE) stretched to [0, 1]."""
    total = np.zeros((SIZE, SIZE))
    for octave in range(3):
        n = cells * 2**octave
        lattice = rng.uniform(size=(n, n))
        position = np.arange(SIZE) / SIZE * n
        low = position.astype(int) % n
        t = position % 1
        t = t * t * (3 - 2 * t)
        high = (low + 1) % n
        rows = lattice[low] * (1 - t)[:, None] + lattice[high] * t[:, None]
        total += (rows[:, low] * (1 - t) + rows[:, high] * t) / 2**octave
    return (total - total.min()) / np.ptp(total)


def blend_colors(share: np.ndarray, dark: np.ndarray, light: np.ndarray) -> np.ndarray:
    """(SIZE, SIZE, 3) mix of two scene-linear colours, with a share (SIZE, SIZE) of the light one."""
    return dark + share[..., None] * (light - dark)


def normal_map(height: np.ndarray, slope: float) -> np.ndarray:
    """(SIZE, SIZE, 3) tangent-space normals of a periodic height field, encoded as (n + 1) / 2, +Y up."""
    dx = (np.roll(height, -1, 1) - np.roll(height, 1, 1)) * slope
    dy = (np.roll(height, -1, 0) - np.roll(height, 1, 0)) * slope
    n = np.stack([-dx, -dy, np.ones_like(dx)], -1)
    return n / np.linalg.norm(n, axis=-1, keepdims=True) / 2 + 0.5


def make_image(name: str, values: np.ndarray, *, is_color: bool) -> bpy.types.Image:
    """An 8-bit image of (SIZE, SIZE) or (SIZE, SIZE, 3) values; colours are scene-linear and stored as sRGB bytes."""
    if values.ndim == 2:
        values = values[..., None].repeat(3, axis=-1)
    if is_color:
        values = linear_to_srgb(values)
    image = bpy.data.images.new(name, SIZE, SIZE)
    image.colorspace_settings.name = "sRGB" if is_color else "Non-Color"
    pixels = np.concatenate([values, np.ones((SIZE, SIZE, 1))], axis=-1)
    image.pixels.foreach_set(pixels.astype(np.float32).ravel())
    image.update()
    return image


def make_panorama(name: str, pixels: np.ndarray, color_space: str) -> bpy.types.Image:
    """A lat-long map (H, W, 3) f32 as an opaque float image, the first row at the bottom."""
    height, width = pixels.shape[:2]
    image = bpy.data.images.new(name, width, height, float_buffer=True)
    image.colorspace_settings.name = color_space
    image.pixels.foreach_set(np.dstack([pixels, np.ones((height, width), np.float32)]).ravel())
    image.update()
    return image


def mean_radiance(pixels: np.ndarray) -> float:
    """Over all directions, of a lat-long map (H, W, 3)."""
    rows = np.sin(np.pi * (np.arange(len(pixels)) + 0.5) / len(pixels))  # their share of the sphere
    return float(np.average(pixels.mean(axis=(1, 2)), weights=rows))
