# SPDX-License-Identifier: GPL-3.0-or-later
"""The pictures of spheres that tools.datagen.spheres makes, as the material autoencoder takes them."""
from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from .errors import TrainingError

HELD_OUT = 200


def load_spheres(folder: Path) -> tuple[Tensor, Tensor]:
    """Parameters (n, k) and pictures (n, 3, 64, 64) in log10(1 + radiance) space, clamped to the decoder's [0, 1].

    Raises TrainingError when the folder has no more spheres than are held out, or one of its files cannot be read.
    """
    remedy = f"make more with python -m tools.datagen.spheres {folder.parent}"
    if not folder.is_dir():
        raise TrainingError(f"there is no folder {folder}: check SPHERES_DIR, or {remedy}")
    shards = [_load_shard(path) for path in sorted(folder.glob("spheres_*.npz"))]
    count = sum(len(images) for _, images in shards)
    if count <= HELD_OUT:
        raise TrainingError(f"{folder} holds {count} spheres (spheres_*.npz) and {HELD_OUT} are held out: {remedy}")
    parameters, images = (np.concatenate(arrays) for arrays in zip(*shards, strict=True))
    images = images.astype(np.float32)
    return torch.from_numpy(parameters), torch.from_numpy(np.log10(1 + images)).clamp(0, 1).permute(0, 3, 1, 2)


def _load_shard(path: Path) -> tuple[np.ndarray, np.ndarray]:
    try:
        with np.load(path) as shard:
            return shard["parameters"], shard["images"]
    except Exception as error:  # a damaged archive raises whatever the damage leads to
        raise TrainingError(f"{path} cannot be read ({error}): delete it, and tools.datagen.spheres makes it "
                            "again") from error
