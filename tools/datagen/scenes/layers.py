# SPDX-License-Identifier: GPL-3.0-or-later
"""The layered profile: scenes of the full one with layers and lobes that no estimate of light knows exactly.

Coats, sheen, subsurface scattering, thin films, brushed metal and rough diffuse surfaces: where traced and estimated
light differ by more than noise, a network has to see which of both is wrong.
"""
from __future__ import annotations

import bpy
import numpy as np

from .materials import PRINCIPLED, random_color, set_inputs

LAYERED = 0.6  # chance of each material


def add_layers(rng: np.random.Generator) -> None:
    """Add layers to the surfaces of the open scene that do not shine."""
    for material in sorted(bpy.data.materials, key=lambda material: material.name):
        if is_dark_surface(material) and rng.uniform() < LAYERED:
            set_inputs(material, KINDS[rng.integers(len(KINDS))](rng))


def is_dark_surface(material: bpy.types.Material) -> bool:
    """Neither a lamp nor a medium."""
    node = material.node_tree and material.node_tree.nodes.get(PRINCIPLED)
    return node is not None and not node.inputs["Emission Strength"].default_value


def coat(rng: np.random.Generator) -> dict[str, object]:
    return {"Coat Weight": rng.uniform(0.3, 1), "Coat Roughness": rng.uniform(0, 0.3), "Coat IOR": rng.uniform(1.3, 2)}


def sheen(rng: np.random.Generator) -> dict[str, object]:
    return {"Sheen Weight": rng.uniform(0.3, 1), "Sheen Roughness": rng.uniform(0.2, 1),
            "Sheen Tint": random_color(rng, "object")}


def subsurface(rng: np.random.Generator) -> dict[str, object]:
    return {"Subsurface Weight": rng.uniform(0.3, 1), "Subsurface Scale": 10 ** rng.uniform(-2, -0.7)}


def film(rng: np.random.Generator) -> dict[str, object]:
    """Nanometres, on a surface that mirrors more than others."""
    return {"Thin Film Thickness": rng.uniform(100, 800), "Thin Film IOR": rng.uniform(1.2, 2),
            "Specular IOR Level": rng.uniform(0.5, 1), "Roughness": rng.uniform(0, 0.4)}


def brushed(rng: np.random.Generator) -> dict[str, object]:
    return {"Metallic": 1, "Anisotropic": rng.uniform(0.3, 1), "Anisotropic Rotation": rng.uniform(),
            "Roughness": rng.uniform(0.1, 0.6)}


def rough_diffuse(rng: np.random.Generator) -> dict[str, object]:
    return {"Diffuse Roughness": rng.uniform(0.3, 1), "Specular IOR Level": rng.uniform(0, 0.5)}


KINDS = coat, coat, sheen, sheen, subsurface, subsurface, film, brushed, rough_diffuse
