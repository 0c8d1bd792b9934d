# SPDX-License-Identifier: GPL-3.0-or-later
"""Clear glass between the camera and what it looks at."""
from __future__ import annotations

import bpy
import numpy as np

from .materials import set_value
from .objects import build_object


def build_glass(rng: np.random.Generator, camera: bpy.types.Object, name: str) -> bpy.types.Object:
    """An object of clear glass 35 to 65 % of the way from the origin to the camera, over a part of the picture."""
    glass = build_object(rng, name, 600)
    eye = np.array(camera.location)
    distance, nearness = np.linalg.norm(eye), rng.uniform(0.35, 0.65)
    width = 2 * np.tan(camera.data.angle / 2) * distance * (1 - nearness)  # of the picture there
    diameter = min(width * rng.uniform(0.3, 0.6), 0.8 * distance * (1 - nearness))
    glass.scale = [diameter] * 3
    glass.rotation_euler = rng.uniform(-np.pi, np.pi, 3)
    glass.location = nearness * eye + rng.uniform(-0.2, 0.2, 3) * width
    glass.data.materials.append(clear_material(rng))
    return glass


def clear_material(rng: np.random.Generator) -> bpy.types.Material:
    """Smooth, nearly colourless glass of index 1.3 to 1.6."""
    material = bpy.data.materials.new("clear glass")
    material.use_nodes = True
    shader = material.node_tree.nodes["Principled BSDF"]
    set_value(shader, "Base Color", (*map(float, rng.uniform(0.9, 1.0, 3)), 1.0))
    set_value(shader, "Transmission Weight", 1.0)
    set_value(shader, "Roughness", rng.choice([0.0, rng.uniform(0.0, 0.05)]))
    set_value(shader, "IOR", rng.uniform(1.3, 1.6))
    return material
