# SPDX-License-Identifier: GPL-3.0-or-later
"""Worlds: the HDRIs that Blender ships for its studio lights, a constant colour, or nothing."""
from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np

from . import own, own_data

STUDIO_LIGHTS = ("city", "courtyard", "forest", "interior", "night", "studio", "sunrise", "sunset")
ORDERS = ("RGB", "RBG", "GRB", "GBR", "BRG", "BGR")
IMPORTANCE_MAP = 256  # Cycles' automatic choice costs 1.3 s a scene


def load_environment(name: str) -> bpy.types.Image:
    """One of Blender's studio lights, an equirectangular map in scene-linear radiance.

    Raises FileNotFoundError when this Blender was installed without its data files.
    """
    path = Path(bpy.utils.system_resource("DATAFILES")) / "studiolights" / "world" / f"{name}.exr"
    if not path.is_file():
        raise FileNotFoundError(f"studio light {path} is missing: install Blender with its data files")
    return bpy.data.images.load(str(path), check_existing=True)


def build_world(rng: np.random.Generator, kind: str, radiance: float) -> None:
    """Give the scene a world of `kind` "hdri", "constant" or "none" with about this mean radiance."""
    world, background = new_world()
    background.inputs["Strength"].default_value = radiance if kind != "none" else 0.0
    if kind == "constant":
        color = rng.uniform(0.3, 1.0, 3)
        background.inputs["Color"].default_value = (*(color / color.mean()), 1.0)
    elif kind == "hdri":
        add_hdri(rng, world, background, radiance)


def new_world() -> tuple[bpy.types.World, bpy.types.ShaderNode]:
    """The scene's world, with a map for importance sampling of a fixed size, and its Background node."""
    world = bpy.context.scene.world = bpy.data.worlds.new("world")
    world.use_nodes = True
    world.cycles.sampling_method, world.cycles.sample_map_resolution = "MANUAL", IMPORTANCE_MAP
    return world, world.node_tree.nodes["Background"]


def add_hdri(rng: np.random.Generator, world: bpy.types.World, background: bpy.types.ShaderNode,
             radiance: float) -> None:
    """A studio light or a panorama of the user's, its channels permuted against colour bias.

    It is turned about Z, and by chance about all axes.
    """
    path = own.current.chosen(rng, "panoramas")
    found = own_data.panorama(path, str(rng.choice(ORDERS))) if path else None
    image, scale = found or permuted_environment(str(rng.choice(STUDIO_LIGHTS)), str(rng.choice(ORDERS)))
    background.inputs["Strength"].default_value = radiance * scale
    tilt = rng.uniform(-np.pi, np.pi, 2) if rng.uniform() < 0.2 else (0.0, 0.0)
    link_panorama(world, background, image, (*tilt, rng.uniform(-np.pi, np.pi)))


def link_panorama(world: bpy.types.World, background: bpy.types.ShaderNode, image: bpy.types.Image, rotation) -> None:
    """`image`, turned by XYZ angles in radians, as the colour of the world."""
    nodes, links = world.node_tree.nodes, world.node_tree.links
    coordinates, mapping, texture = (nodes.new(f"ShaderNode{n}") for n in ("TexCoord", "Mapping", "TexEnvironment"))
    mapping.vector_type, texture.image = "POINT", image
    mapping.inputs["Rotation"].default_value = rotation
    links.new(coordinates.outputs["Generated"], mapping.inputs["Vector"])
    links.new(mapping.outputs["Vector"], texture.inputs["Vector"])
    links.new(texture.outputs["Color"], background.inputs["Color"])


def permuted_environment(name: str, order: str) -> tuple[bpy.types.Image, float]:
    """The map with its channels in `order`, kept for later scenes, and the factor that makes its mean radiance 1."""
    key = f"{name} {order}"
    image = bpy.data.images.get(key)
    if image is None:
        source = load_environment(name)
        width, height = source.size
        pixels = np.empty(width * height * 4, np.float32)
        source.pixels.foreach_get(pixels)
        # To the 512x256 of a RenderScene.
        pixels = pixels.reshape(height // 2, 2, width // 2, 2, 4).mean(axis=(1, 3))
        pixels = pixels[..., ["RGB".index(c) for c in order] + [3]]
        height, width = pixels.shape[:2]
        image = bpy.data.images.new(key, width, height, float_buffer=True)
        image.colorspace_settings.name = source.colorspace_settings.name
        image.pixels.foreach_set(np.ascontiguousarray(pixels).ravel())
        image.update()
        rows = np.sin(np.pi * (np.arange(height) + 0.5) / height)
        image["mean"] = float(np.average(pixels[..., :3].mean(axis=(1, 2)), weights=rows))
    return image, 1.0 / image["mean"]
