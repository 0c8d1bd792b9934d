# SPDX-License-Identifier: GPL-3.0-or-later
"""The five material classes of the paper's section "Training Data", as Principled BSDFs.

Homogeneous dielectric (diffuse + specular), homogeneous metallic-rough, textured versions of both, and transparent.
MatSynth's photographed maps are replaced by procedural ones, and those of the user's own folders.
"""
from __future__ import annotations

import colorsys
from pathlib import Path

import bpy
import numpy as np

from . import own, own_data
from .textures import color_map, make_image, normal_map, pattern

CLASSES = ("dielectric", "metallic", "textured_dielectric", "textured_metallic", "transparent")
CHANCES = {  # profile and use -> chance of each class
    ("full", "object"): (2 / 9, 2 / 9, 3 / 18, 3 / 18, 2 / 9),
    ("full", "room"): (0.45, 0.1, 0.3, 0.15, 0.0),  # rooms are never glass (docs/scene-input.md 3.3)
    ("paper", "object"): (2 / 9, 2 / 9, 1 / 9, 1 / 9, 3 / 9),
    ("paper", "room"): (1 / 3, 1 / 3, 1 / 6, 1 / 6, 0.0),
    ("simple", "object"): (0.6, 0.4, 0.0, 0.0, 0.0),
    ("simple", "room"): (0.85, 0.15, 0.0, 0.0, 0.0),
}


def build_material(rng: np.random.Generator, profile: str, use: str, kind: str | None = None) -> bpy.types.Material:
    """A random material for `use` "object" or "room", of one of CLASSES or of any of them."""
    kind = kind or str(rng.choice(CLASSES, p=CHANCES[profile, use]))
    material = bpy.data.materials.new(kind)
    material.use_nodes = True
    shader = material.node_tree.nodes["Principled BSDF"]
    set_value(shader, "Base Color", (*random_color(rng, use), 1.0))
    set_value(shader, "Roughness", random_roughness(rng, use))
    set_value(shader, "IOR", rng.uniform(1.3, 1.8))
    set_value(shader, "Specular IOR Level", rng.choice([0.5, rng.uniform()]))
    if kind.endswith("metallic"):
        set_value(shader, "Metallic", rng.choice([1.0, rng.uniform()]))
    if kind.startswith("textured"):
        add_maps(rng, material, shader, use, metallic=kind.endswith("metallic"))
    if kind == "transparent":
        set_value(shader, "Transmission Weight", rng.choice([1.0, rng.uniform() ** 0.7]))
        set_value(shader, "Metallic", rng.choice([0.0, 0.0, rng.uniform()]))
        set_value(shader, "IOR", rng.uniform(1.05, 2.0))
        set_value(shader, "Roughness", 10.0 ** rng.uniform(-2.0, 0.0))
    return material


def set_value(shader: bpy.types.ShaderNode, name: str, value) -> None:
    shader.inputs[name].default_value = value if isinstance(value, tuple) else float(value)


def random_color(rng: np.random.Generator, use: str) -> tuple[float, float, float]:
    """Scene-linear albedo: uniform RGB, or a pale colour; rooms are mostly pale and light."""
    if rng.uniform() < (0.2 if use == "room" else 0.5):
        return tuple(map(float, rng.uniform(0.02, 0.95, 3)))
    value = rng.uniform(0.35, 0.9) if use == "room" else rng.uniform(0.05, 0.9)
    return colorsys.hsv_to_rgb(rng.uniform(), rng.uniform(0, 0.4), value)


def random_roughness(rng: np.random.Generator, use: str) -> float:
    """Log-uniform in [0.01, 1] as in the paper for a third, otherwise the middle range that artists use."""
    if rng.uniform() < (0.15 if use == "room" else 0.35):
        return 10.0 ** rng.uniform(-2.0, 0.0)
    return rng.uniform(0.3, 1.0) if use == "room" else rng.uniform(0.1, 1.0)


def add_maps(rng: np.random.Generator, material: bpy.types.Material, shader: bpy.types.ShaderNode, use: str,
             *, metallic: bool) -> None:
    """Base colour always; roughness, metallic and normal maps of the same pattern by chance, or a set of the user's."""
    files = own.current.chosen(rng, "textures")
    if files and add_own_maps(material, shader, files, metallic=metallic):
        return
    value = pattern(rng)
    base = color_map(value, np.array(random_color(rng, use)), np.array(random_color(rng, use)))
    link_image(material, make_image("base color", base, color=True), shader.inputs["Base Color"])
    if rng.uniform() < 0.5:
        low, high = rng.uniform(0.05, 1.0, 2)
        rough = make_image("roughness", low + value * (high - low), color=False)
        link_image(material, rough, shader.inputs["Roughness"])
    if metallic and rng.uniform() < 0.5:
        link_image(material, make_image("metallic", value, color=False), shader.inputs["Metallic"])
    if rng.uniform() < 0.3:
        image = make_image("normal", normal_map(pattern(rng), rng.uniform(0.5, 2.0)), color=False)
        link_normals(material, shader, image)


def add_own_maps(material: bpy.types.Material, shader: bpy.types.ShaderNode, files: dict[str, Path], *,
                 metallic: bool) -> bool:
    """What there is of a set of maps; whether it can be used."""
    maps = own_data.maps(files)
    if maps is None:
        return False
    link_image(material, maps["base"], shader.inputs["Base Color"])
    if "roughness" in maps:
        link_image(material, maps["roughness"], shader.inputs["Roughness"])
    if metallic and "metallic" in maps:
        link_image(material, maps["metallic"], shader.inputs["Metallic"])
    if "normal" in maps:
        link_normals(material, shader, maps["normal"])
    return True


def link_normals(material: bpy.types.Material, shader: bpy.types.ShaderNode, image: bpy.types.Image) -> None:
    node = material.node_tree.nodes.new("ShaderNodeNormalMap")
    link_image(material, image, node.inputs["Color"])
    material.node_tree.links.new(node.outputs["Normal"], shader.inputs["Normal"])


def link_image(material: bpy.types.Material, image: bpy.types.Image, socket: bpy.types.NodeSocket) -> None:
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    material.node_tree.links.new(node.outputs["Color"], socket)


def emissive_material(color: np.ndarray, strength: float) -> bpy.types.Material:
    """White and rough, radiating `strength * color` W/(m^2 sr) on both sides (docs/scene-input.md 3.5)."""
    material = bpy.data.materials.new("light")
    material.use_nodes = True
    shader = material.node_tree.nodes["Principled BSDF"]
    set_value(shader, "Base Color", (1.0, 1.0, 1.0, 1.0))
    set_value(shader, "Specular IOR Level", 0.0)
    set_value(shader, "Roughness", 1.0)
    set_value(shader, "Emission Color", (*map(float, color), 1.0))
    set_value(shader, "Emission Strength", strength)
    return material
