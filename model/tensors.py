# SPDX-License-Identifier: GPL-3.0-or-later
"""The last step from arrays to tensors, shared by all networks."""
from __future__ import annotations

from dataclasses import fields

import numpy as np
import torch
from torch import Tensor

from .camera import view_rays
from .network.inputs import ViewInputs, VolumeInputs
from .scene import HEIGHT, NORMAL, RenderScene, View, Volumes

FARTHEST_LIGHT = 3.0  # network units; training lights are 2.1 to 2.7 away (docs/scene-input.md 1.2)


def nearer_lights(scene: RenderScene) -> np.ndarray:
    """(N, 3, 3) corners with far lights brought near: shrunk towards the centre, where they look the same as before."""
    distance = np.linalg.norm(scene.triangles.mean(axis=1), axis=1)
    shrink = np.where(scene.is_light, np.minimum(1, FARTHEST_LIGHT / np.maximum(distance, 1e-6)), 1)
    return (scene.triangles * shrink[:, None, None]).astype(np.float32)


def material_tiles(pooled: Tensor, mapper) -> Tensor:
    """(T, 11, q, q) BSDF parameters, normal and height -> (T, 13, q, q) latents, normal and height.

    mapper: (P, 7) BSDF parameters -> (P, 9) latents.
    """
    parameters = pooled[:, : NORMAL.start].flatten(2).transpose(1, 2)  # (T, q^2, 7)
    constant = (parameters == parameters[:, :1]).all(2).all(1)
    with torch.no_grad():
        latents = mapper(parameters[:, :1]).expand(-1, parameters.shape[1], -1).clone()
        if not constant.all():
            latents[~constant] = mapper(parameters[~constant])
    latents = latents.transpose(1, 2).unflatten(2, pooled.shape[2:])
    return torch.cat([latents, pooled[:, NORMAL], pooled[:, HEIGHT : HEIGHT + 1]], 1)


def volume_inputs(volumes: Volumes | None) -> VolumeInputs | None:
    if volumes is None or not len(volumes):
        return None
    return VolumeInputs(**{f.name: torch.from_numpy(getattr(volumes, f.name)) for f in fields(Volumes)})


def view_inputs(view: View) -> ViewInputs:
    """Camera and rays of one normalised view."""
    return ViewInputs(*(torch.from_numpy(x)[None] for x in view_rays(view)))
