# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials of surfaces, as Principled BSDFs.

The five classes of the paper's section "Training Data": homogeneous dielectric (diffuse + specular), homogeneous
metallic-rough, textured versions of both, and transparent. MatSynth's photographed maps are replaced by procedural
ones, and those of the user's own folders. Also mirrors, clear glass, and what glows.
"""
from __future__ import annotations

import colorsys
from pathlib import Path

import bpy
import numpy as np

from . import own_data
from .own_files import OWN_FILES
from .textures import blend_colors, make_image, make_pattern, normal_map

CLASSES = ("dielectric", "metallic", "textured_dielectric", "textured_metallic", "transparent")
CHANCES = {  # profile and use -> chance of each class
    ("full", "object"): (2 / 9, 2 / 9, 3 / 18, 3 / 18, 2 / 9),
    ("full", "room"): (0.45, 0.1, 0.3, 0.15, 0.0),  # rooms are never glass (docs/scene-input.md 3.3)
    ("simple", "object"): (0.6, 0.4, 0.0, 0.0, 0.0),
    ("simple", "room"): (0.85, 0.15, 0.0, 0.0, 0.0),
}
ROUGHEST_MIRROR = 0.1
PRINCIPLED = "Principled BSDF"  # the name of its node


def build_material(rng: np.random.Generator, profile: str, use: str, kind: str | None = None) -> bpy.types.Material:
    """A random material for `use` "object" or "room", of one of CLASSES or of any of them."""
    kind = kind or str(rng.choice(CLASSES, p=CHANCES[profile, use]))
    material = new_material(kind, {
        "Base Color": random_color(rng, use), "Roughness": random_roughness(rng, use), "IOR": rng.uniform(1.3, 1.8),
        "Specular IOR Level": rng.choice([0.5, rng.uniform()])})
    if kind.endswith("metallic"):
        set_inputs(material, {"Metallic": rng.choice([1.0, rng.uniform()])})
    if kind.startswith("textured"):
        add_maps(rng, material, use, is_metallic=kind.endswith("metallic"))
    if kind == "transparent":
        set_inputs(material, {
            "Transmission Weight": rng.choice([1.0, rng.uniform() ** 0.7]),
            "Metallic": rng.choice([0.0, 0.0, rng.uniform()]), "IOR": rng.uniform(1.05, 2.0),
            "Roughness": 10.0 ** rng.uniform(-2.0, 0.0)})
    return material


def mirror_material(rng: np.random.Generator) -> bpy.types.Material:
    """Bright metal, half of it perfectly smooth."""
    return new_material("mirror", {
        "Base Color": rng.uniform(0.7, 0.98) * rng.uniform(0.9, 1.0, 3), "Metallic": 1.0,
        "Roughness": rng.choice([0.0, rng.uniform(0.0, ROUGHEST_MIRROR)])})


def clear_glass_material(rng: np.random.Generator) -> bpy.types.Material:
    """Smooth, nearly colourless glass of index 1.3 to 1.6."""
    return new_material("clear glass", {
        "Base Color": rng.uniform(0.9, 1.0, 3), "Transmission Weight": 1.0,
        "Roughness": rng.choice([0.0, rng.uniform(0.0, 0.05)]), "IOR": rng.uniform(1.3, 1.6)})


def emissive_material(color: np.ndarray, strength: float) -> bpy.types.Material:
    """White and rough, radiating `strength * color` W/(m^2 sr) on both sides (docs/scene-input.md 3.5)."""
    return new_material("light", {
        "Base Color": (1.0, 1.0, 1.0), "Specular IOR Level": 0.0, "Roughness": 1.0, "Emission Color": color,
        "Emission Strength": strength})


def new_material(name: str, inputs: dict[str, object]) -> bpy.types.Material:
    """A Principled BSDF with these inputs, the others as Blender has them."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    set_inputs(material, inputs)
    return material


def principled(material: bpy.types.Material) -> bpy.types.ShaderNode:
    return material.node_tree.nodes[PRINCIPLED]


def set_inputs(material: bpy.types.Material, inputs: dict[str, object]) -> None:
    """Numbers, and colours as scene-linear RGB, by the names of the Principled BSDF's inputs."""
    for name, value in inputs.items():
        principled(material).inputs[name].default_value = (*map(float, value), 1.0) if np.ndim(value) else float(value)


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


def add_maps(rng: np.random.Generator, material: bpy.types.Material, use: str, *, is_metallic: bool) -> None:
    """Base colour always; roughness, metallic and normal maps of the same pattern by chance, or a set of the user's."""
    files = OWN_FILES.choose(rng, "textures")
    if files and add_own_maps(material, files, is_metallic=is_metallic):
        return
    inputs, pattern = principled(material).inputs, make_pattern(rng)
    base = blend_colors(pattern, np.array(random_color(rng, use)), np.array(random_color(rng, use)))
    link_image(material, make_image("base color", base, is_color=True), inputs["Base Color"])
    if rng.uniform() < 0.5:
        low, high = rng.uniform(0.05, 1.0, 2)
        image = make_image("roughness", low + pattern * (high - low), is_color=False)
        link_image(material, image, inputs["Roughness"])
    if is_metallic and rng.uniform() < 0.5:
        link_image(material, make_image("metallic", pattern, is_color=False), inputs["Metallic"])
    if rng.uniform() < 0.3:
        link_normal_map(material, make_image("normal", normal_map(make_pattern(rng), rng.uniform(0.5, 2.0)),
                                             is_color=False))


def add_own_maps(material: bpy.types.Material, files: dict[str, Path], *, is_metallic: bool) -> bool:
    """The maps of a set of the user's, as far as there are any; whether it can be used."""
    maps = own_data.load_maps(files)
    if maps is None:
        return False
    inputs = principled(material).inputs
    link_image(material, maps["base"], inputs["Base Color"])
    if "roughness" in maps:
        link_image(material, maps["roughness"], inputs["Roughness"])
    if is_metallic and "metallic" in maps:
        link_image(material, maps["metallic"], inputs["Metallic"])
    if "normal" in maps:
        link_normal_map(material, maps["normal"])
    return True


def link_normal_map(material: bpy.types.Material, image: bpy.types.Image) -> None:
    node = material.node_tree.nodes.new("ShaderNodeNormalMap")
    link_image(material, image, node.inputs["Color"])
    material.node_tree.links.new(node.outputs["Normal"], principled(material).inputs["Normal"])


def link_image(material: bpy.types.Material, image: bpy.types.Image, socket: bpy.types.NodeSocket) -> None:
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    material.node_tree.links.new(node.outputs["Color"], socket)
