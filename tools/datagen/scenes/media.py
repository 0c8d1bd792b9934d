# SPDX-License-Identifier: GPL-3.0-or-later
"""Participating media: closed meshes that hold a homogeneous volume shader (docs/scene-input.md 5.4, 5.6)."""
from __future__ import annotations

import bpy
import numpy as np

from .meshes import add_object, make_box
from .objects import build_object
from .rooms import Room

FILLED = 0.98  # of a room by fog: no face of it lies in a wall


def build_volume(rng: np.random.Generator, room: Room, name: str) -> bpy.types.Object:
    """A puff of smoke or coloured liquid, 0.35 to 0.7 across, somewhere in the room."""
    volume = build_object(rng, name, 500)
    diameter = rng.uniform(0.35, 0.7)
    volume.scale = [diameter] * 3
    volume.rotation_euler = rng.uniform(-np.pi, np.pi, 3)
    reach = max(0.0, min(0.4, room.half) - diameter / 2)
    volume.location = (*rng.uniform(-reach, reach, 2), room.floor + diameter / 2 + rng.uniform(0, 0.3))
    volume.data.materials.append(volume_material(rng))
    return volume


def build_fog(rng: np.random.Generator, room: Room, name: str) -> bpy.types.Object:
    """Thin haze to dense fog in all of a room, or in a box of 1.5 to 4 around what stands on a ground or floats.

    Its optical depth across is 0.05 to 3.
    """
    side, lowest = rng.uniform(1.5, 4.0), room.floor if room.surfaces else -1.0
    height = side * rng.uniform(0.3, 1.0)
    if room.walls:
        side, height = 2 * room.half * FILLED, room.height * FILLED
    mesh = make_box(name, np.array([-side / 2, -side / 2, lowest]), np.array([side / 2, side / 2, lowest + height]))
    mesh.materials.append(fog_material(rng, 0.05 * 60 ** rng.uniform() / side))
    return add_object(name, mesh)


def fog_material(rng: np.random.Generator, density: float) -> bpy.types.Material:
    """A Principled Volume of pale colour, mostly scattering."""
    material, output = new_medium("fog")
    shader = material.node_tree.nodes.new("ShaderNodeVolumePrincipled")
    shader.inputs["Density"].default_value = density
    shader.inputs["Color"].default_value = (*(rng.uniform(0.5, 1.0) * rng.uniform(0.85, 1.0, 3)), 1.0)
    material.node_tree.links.new(shader.outputs[0], output.inputs["Volume"])
    return material


def volume_material(rng: np.random.Generator) -> bpy.types.Material:
    """Scattering and absorption per channel; the coefficients make optical depths of about 0.1 to 5 across the mesh."""
    material, output = new_medium("volume")
    nodes, links = material.node_tree.nodes, material.node_tree.links
    if rng.uniform() < 0.5:
        shader = nodes.new("ShaderNodeVolumePrincipled")
        shader.inputs["Density"].default_value = 10.0 ** rng.uniform(-0.3, 1.0)
        shader.inputs["Color"].default_value = (*rng.uniform(0.3, 1.0, 3), 1.0)
    else:
        shader = nodes.new("ShaderNodeAddShader")
        for i, kind in enumerate(("ShaderNodeVolumeScatter", "ShaderNodeVolumeAbsorption")):
            part = nodes.new(kind)
            part.inputs["Density"].default_value = 10.0 ** rng.uniform(-0.5, 0.8)
            part.inputs["Color"].default_value = (*rng.uniform(0.1, 1.0, 3), 1.0)
            links.new(part.outputs["Volume"], shader.inputs[i])
    links.new(shader.outputs[0], output.inputs["Volume"])
    return material


def new_medium(name: str) -> tuple[bpy.types.Material, bpy.types.ShaderNode]:
    """A material without a shader, and its output node."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    material.node_tree.nodes.clear()
    return material, material.node_tree.nodes.new("ShaderNodeOutputMaterial")
