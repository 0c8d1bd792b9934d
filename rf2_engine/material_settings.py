# SPDX-License-Identifier: GPL-3.0-or-later
"""`material.renderformer_v2`: an appearance latent in place of the nodes (docs/scene-input.md 3)."""
from __future__ import annotations

import bpy
import numpy as np
from bpy.props import BoolProperty, FloatVectorProperty

from .registering import classes, pairs, pointer

COUNT = 9


class RenderFormerMaterialSettings(bpy.types.PropertyGroup):
    use_latent: BoolProperty(
        name="Appearance Latent",
        description="Published weights take the nine numbers below for how this material reflects light, instead of "
                    "its nodes. Normal map, displacement and emission are still those of the nodes. Everything else "
                    "shows the nodes: the bundled weights, Cycles and the viewport",
    )
    latent: FloatVectorProperty(
        name="Latent", size=COUNT, min=-1, max=1, precision=4,
        description="A point in the space of the published material autoencoder, such as that of a measured material",
    )


def latent_of(material: bpy.types.Material) -> tuple[float, ...] | None:
    """The chosen latent; nine zeros are none. Scenes can be converted while the add-on is not registered."""
    settings = getattr(material, "renderformer_v2", None)
    return tuple(settings.latent) if settings and settings.use_latent and any(settings.latent) else None


def set_latent(material: bpy.types.Material, numbers: np.ndarray) -> None:
    """Raises ValueError saying what was expected of the numbers."""
    flat = np.asarray(numbers)
    if flat.dtype.kind not in "fiu" or flat.size != COUNT or not np.isfinite(flat).all() or np.abs(flat).max() > 1:
        raise ValueError(f"expected {COUNT} numbers from -1 to 1, found {flat.dtype} of shape {flat.shape}")
    material.renderformer_v2.latent = flat.reshape(COUNT).tolist()
    material.renderformer_v2.use_latent = True


def read_latent(file) -> np.ndarray:
    """The array in a .npy file. Raises ValueError that names the file, and OSError."""
    try:
        return np.load(file, allow_pickle=False)
    except (ValueError, EOFError) as error:
        raise ValueError(f"{file} is no .npy file of numbers ({error})") from error


register, unregister = pairs(
    classes(RenderFormerMaterialSettings),
    pointer(bpy.types.Material, "renderformer_v2", RenderFormerMaterialSettings))
