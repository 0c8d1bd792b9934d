# SPDX-License-Identifier: GPL-3.0-or-later
"""Emitters of some extent: thin closed panels (2 x 2 x 0.05 and smaller), and screens that show a picture."""
from __future__ import annotations

import bpy
import numpy as np

from mathutils import Vector

from .lights import light_color, light_position, radiance
from .materials import emissive_material, link_image, random_color
from .mesh import box, box_uv
from .templates import Room
from .textures import color_map, make_image, pattern

THICKNESS = 0.025   # of the width
SCREEN = 0.4        # chance
SEEN = 0.7          # chance that the camera sees it


def build_panel(rng: np.random.Generator, room: Room, name: str, share: float) -> bpy.types.Object:
    """A thin box that brings the irradiance `share` to the origin; SCREEN of them with a texture on it."""
    width = rng.uniform(0.3, 0.8) if room.enclosed else rng.uniform(0.4, 2.0)
    size = width * np.array([1.0, rng.uniform(0.4, 1.0), THICKNESS * rng.uniform(0.5, 1.5)])
    mesh = box(name, -size / 2, size / 2)
    box_uv(mesh)
    position = light_position(rng, room)
    area = 2 * (size[0] * size[1] + size[1] * size[2] + size[2] * size[0])
    strength = radiance(share, position, area, closed=True)
    mesh.materials.append(screen_material(rng, strength) if rng.uniform() < SCREEN else
                          emissive_material(light_color(rng), strength))
    panel = bpy.data.objects.new(name, mesh)
    panel.location = position
    panel.rotation_euler = Vector(rng.uniform(-0.2, 0.2, 3) - position).to_track_quat("-Z", "Y").to_euler()
    panel.visible_camera = bool(rng.uniform() < SEEN)
    bpy.context.scene.collection.objects.link(panel)
    return panel


def screen_material(rng: np.random.Generator, strength: float) -> bpy.types.Material:
    """Radiates a two-coloured pattern whose mean is `strength`."""
    values = color_map(pattern(rng), *(np.array(random_color(rng, "object")) for _ in range(2)))
    material = emissive_material(np.ones(3), strength / max(values.mean(), 0.02))
    shader = material.node_tree.nodes["Principled BSDF"]
    link_image(material, make_image("screen", values, color=True), shader.inputs["Emission Color"])
    return material
