# SPDX-License-Identifier: GPL-3.0-or-later
"""Panoramas from pinhole pictures: the published network renders the faces of a cube around the camera.

They overlap, and where they do the panorama is a mean of them that changes smoothly, so it has no seams.
"""
from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from ..camera import view_rays
from ..progress import steps
from ..scene import View

OVERLAP = math.radians(5)  # beyond the edge of a face, and within it where its share begins to fall
TURNS = tuple(np.float64(axes).T for axes in (  # right, up, backward of the faces, in the camera's frame
    ((1, 0, 0), (0, 1, 0), (0, 0, 1)), ((-1, 0, 0), (0, 1, 0), (0, 0, -1)),
    ((0, 0, 1), (0, 1, 0), (-1, 0, 0)), ((0, 0, -1), (0, 1, 0), (1, 0, 0)),
    ((1, 0, 0), (0, 0, 1), (0, -1, 0)), ((1, 0, 0), (0, 0, -1), (0, 1, 0))))


def cube_faces(view: View, granularity: int) -> list[View]:
    """Square views of all faces, as fine as the panorama; their sides are multiples of `granularity`."""
    focal = view.longer_side / 2
    side = math.ceil(2 * focal * math.tan(math.pi / 4 + OVERLAP) / granularity) * granularity
    faces = []
    for turn in TURNS:
        pose = view.camera_to_world.astype(np.float64)
        pose[:3, :3] = pose[:3, :3] @ turn
        faces.append(View(pose.astype(np.float32), np.float32([focal, focal]), np.float32([side, side]) / 2, side, side,
                          view.longer_side))
    return faces


def join_faces(view: View, faces: list[View], render: Callable[[View], Tensor]) -> Tensor:
    """(3, H, W): the panorama from the pictures (3, h, w) that `render` returns of the faces visible in it."""
    rays, total, weights = view_rays(view)[1], 0.0, 0.0
    samples = [_sample_face(face, rays) for face in faces]
    visible = [(face, sample) for face, sample in zip(faces, samples, strict=True) if sample[1].any()]
    for face, (grid, weight) in steps(visible):
        picture = render(face)
        grid, weight = (torch.from_numpy(array).to(picture.device) for array in (grid, weight))
        sampled = F.grid_sample(picture[None].float(), grid[None], align_corners=False, padding_mode="border")[0]
        total, weights = total + sampled * weight, weights + weight
    return total / weights


def _sample_face(face: View, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(H, W, 2) f32 coordinates from -1 to 1 of rays (H, W, 3) in a face, and (H, W) f32 weights of the face there."""
    right, up, backward = np.moveaxis(rays @ face.camera_to_world[:3, :3], -1, 0)
    forward = (-backward).clip(1e-6)
    x, y = right / forward, -up / forward
    inner, outer = (math.tan(math.pi / 4 + angle) for angle in (-OVERLAP, OVERLAP))
    off = np.where(backward < 0, np.maximum(np.abs(x), np.abs(y)), outer)
    t = ((outer - off) / (outer - inner)).clip(0, 1)
    share = t * t * (3 - 2 * t)
    scale = face.focal[0] / (face.width / 2)
    return np.stack([x, y], axis=-1).clip(-outer, outer) * np.float32(scale), share.astype(np.float32)
