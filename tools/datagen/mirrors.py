# SPDX-License-Identifier: GPL-3.0-or-later
"""Flat mirrors."""
from __future__ import annotations

import bpy
import numpy as np

from .materials import set_value
from .templates import Room, plane

ROUGHEST = 0.1


def build_mirror(rng: np.random.Generator, room: Room, name: str) -> bpy.types.Object:
    """0.4 to 1.2 wide, upright or leaning a little, behind or beside the objects and turned to them."""
    azimuth = np.pi / 2 + rng.uniform(-1.3, 1.3)
    away = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    distance = rng.uniform(0.5, 0.9) if not room.walls else 0.95 * room.half * rng.uniform(0.8, 1.0)
    right = np.array([away[1], -away[0], 0.0]) * rng.uniform(0.4, 1.2)
    up = (np.array([0, 0, 1.0]) + away * rng.uniform(0, 0.25)) * rng.uniform(0.4, 1.0)
    foot = distance * away + np.array([0, 0, room.floor + rng.uniform(0.01, 0.2)])
    mirror = plane(name, rng, foot - right / 2, right, up)
    mirror.data.materials.append(mirror_material(rng))
    return mirror


def mirror_material(rng: np.random.Generator) -> bpy.types.Material:
    """Bright metal, half of it perfectly smooth."""
    material = bpy.data.materials.new("mirror")
    material.use_nodes = True
    shader = material.node_tree.nodes["Principled BSDF"]
    set_value(shader, "Base Color", (*map(float, rng.uniform(0.7, 0.98) * rng.uniform(0.9, 1.0, 3)), 1.0))
    set_value(shader, "Metallic", 1.0)
    set_value(shader, "Roughness", rng.choice([0.0, rng.uniform(0.0, ROUGHEST)]))
    return material
