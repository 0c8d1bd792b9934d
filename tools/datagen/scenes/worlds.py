# SPDX-License-Identifier: GPL-3.0-or-later
"""Worlds: HDRIs that Blender ships for its studio lights, made-up panoramas, Sky Textures, a colour, or nothing."""
from __future__ import annotations

import bpy
import numpy as np

from mathutils import Vector

from renderformer_v2.model.geometry import latlong_directions
from renderformer_v2.model.scene import ENVIRONMENT_SHAPE
from renderformer_v2.rf2_engine.picture_files import studio_light_file

from . import own_data
from .meshes import add_object
from .own_files import OWN_FILES
from .textures import make_panorama, mean_radiance

STUDIO_LIGHTS = ("city", "courtyard", "forest", "interior", "night", "studio", "sunrise", "sunset")
ORDERS = ("RGB", "RBG", "GRB", "GBR", "BRG", "BGR")
IMPORTANCE_MAP = 256  # Cycles' automatic choice costs 1.3 s a scene
MEAN = "mean"         # property of images that later scenes use again: their mean radiance
SUN_LAMP = 0.6        # chance that a sky's sun is a lamp and not a disc in the sky
WAVES = 24            # that make the clouds

# Mean radiance over all directions of Blender 4.5's Sky Texture, and of the sun in it, by air density and elevation.
AIR, ELEVATIONS = (0.5, 1, 2, 3), (2, 5, 10, 20, 40, 80)
SKIES = np.array([(0.89, 1.52, 1.99, 2.03, 1.71, 1.41), (0.63, 1.22, 1.84, 2.20, 2.14, 1.93),
                  (0.38, 0.84, 1.50, 2.16, 2.48, 2.46), (0.27, 0.62, 1.22, 1.97, 2.51, 2.66)])
DISCS = np.array([(1.73, 4.25, 6.70, 8.73, 9.99, 10.55), (0.76, 2.53, 4.89, 7.33, 9.06, 9.89),
                  (0.19, 1.07, 2.84, 5.32, 7.53, 8.73), (0.05, 0.51, 1.76, 3.98, 6.33, 7.74)])


def build_world(rng: np.random.Generator, kind: str, radiance: float) -> None:
    """Give the scene a world of `kind` "hdri", "constant" or "none" with about this mean radiance."""
    world, background = new_world()
    background.inputs["Strength"].default_value = radiance if kind != "none" else 0.0
    if kind == "constant":
        color = rng.uniform(0.3, 1.0, 3)
        background.inputs["Color"].default_value = (*(color / color.mean()), 1.0)
    elif kind == "hdri":
        add_hdri(rng, world, background, radiance)


def build_sky(rng: np.random.Generator, irradiance: float) -> None:
    """A Sky Texture, its sun 2 to 80 degrees high, as a disc or as a lamp that brings 30 to 80 % of the irradiance."""
    world, background = new_world()
    sky = world.node_tree.nodes.new("ShaderNodeTexSky")
    elevation, turn = np.radians(rng.uniform(2, 80)), rng.uniform(-np.pi, np.pi)
    sky.sun_elevation, sky.sun_rotation, sky.air_density = elevation, turn, rng.uniform(0.5, 3.0)
    world.node_tree.links.new(sky.outputs["Color"], background.inputs["Color"])
    sun_share = rng.uniform(0.3, 0.8) if rng.uniform() < SUN_LAMP else 0.0
    sky.sun_disc = not sun_share
    if sun_share:
        toward = [np.sin(turn) * np.cos(elevation), np.cos(turn) * np.cos(elevation), np.sin(elevation)]
        add_sun(rng, Vector(toward), sun_share * irradiance)
    mean = _sky_radiance(np.degrees(elevation), sky.air_density, sky.sun_disc)
    background.inputs["Strength"].default_value = (1 - sun_share) * irradiance / np.pi / mean


def build_panorama(rng: np.random.Generator, radiance: float) -> None:
    """A made-up panorama of this mean radiance."""
    world, background = new_world()
    pixels = random_panorama(rng)[::-1]
    image = make_panorama("panorama", pixels, "Linear Rec.709")
    link_panorama(world, background, image, (0.0, 0.0, rng.uniform(-np.pi, np.pi)))
    background.inputs["Strength"].default_value = radiance / mean_radiance(pixels)


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
    path = OWN_FILES.choose(rng, "panoramas")
    own = own_data.load_panorama(path, str(rng.choice(ORDERS))) if path else None
    image, scale = own or permute_channels(str(rng.choice(STUDIO_LIGHTS)), str(rng.choice(ORDERS)))
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


def load_studio_light(name: str) -> bpy.types.Image:
    """One of Blender's. Raises FileNotFoundError as `studio_light_file`."""
    return bpy.data.images.load(str(studio_light_file(name)), check_existing=True)


def permute_channels(name: str, order: str) -> tuple[bpy.types.Image, float]:
    """A studio light with its channels in `order`, which later scenes use again.

    Also the factor that makes its mean radiance 1.
    """
    key = f"{name} {order}"
    image = bpy.data.images.get(key)
    if image is None:
        source = load_studio_light(name)
        width, height = source.size
        pixels = np.empty(width * height * 4, np.float32)
        source.pixels.foreach_get(pixels)
        # To the 512x256 of a RenderScene.
        pixels = pixels.reshape(height // 2, 2, width // 2, 2, 4).mean(axis=(1, 3))
        pixels = pixels[..., ["RGB".index(c) for c in order]]
        image = make_panorama(key, pixels, source.colorspace_settings.name)
        image[MEAN] = mean_radiance(pixels)
    return image, 1.0 / image[MEAN]


def add_sun(rng: np.random.Generator, toward: Vector, irradiance: float) -> None:
    """A sun in this direction, white or warm."""
    sun = bpy.data.lights.new("sun", "SUN")
    sun.energy, sun.angle = irradiance, np.radians(rng.uniform(0.5, 5))
    sun.color = 1.0, rng.uniform(0.7, 1.0), rng.uniform(0.5, 1.0)
    add_object("sun", sun).rotation_euler = toward.to_track_quat("Z", "Y").to_euler()


def random_panorama(rng: np.random.Generator) -> np.ndarray:
    """(256, 512, 3) f32: ground, horizon and zenith of different colours, clouds, and up to five bright spots."""
    height, width, _ = ENVIRONMENT_SHAPE
    toward = latlong_directions(np.arange(height), height, width)
    up = toward[..., 2:]
    horizon, zenith, ground, cloud = rng.uniform(0.05, 1.0, (4, 3)) ** 1.5
    sky = horizon + np.clip(up, 0, 1) ** rng.uniform(0.3, 1.0) * (zenith - horizon)
    waves = rng.normal(size=(3, WAVES)) * rng.uniform(2, 12, WAVES)
    fog = np.sin(toward @ waves + rng.uniform(0, 2 * np.pi, WAVES)).sum(axis=-1, keepdims=True) / np.sqrt(WAVES / 2)
    sky = sky + np.clip(fog - rng.uniform(-0.5, 2.0), 0, 1) * (cloud - sky)
    sharp = 1 / rng.uniform(0.01, 0.3)
    radiance = ground + np.clip(0.5 + up * sharp, 0, 1) * (sky - ground)
    for _ in range(int(rng.integers(0, 6))):
        axis = rng.normal(size=3) + (0, 0, 0.7)
        narrow = 10 ** rng.uniform(0.5, 3.3)  # lobe 45 to 2 degrees wide
        spot = np.exp(narrow * (toward @ (axis / np.linalg.norm(axis)) - 1))[..., None]
        radiance = radiance + spot * rng.uniform(0.3, 1.0, 3) * narrow ** rng.uniform(0.2, 1.0)
    return radiance.astype(np.float32)


def _sky_radiance(elevation: float, air: float, has_disc: bool) -> float:
    """Mean radiance of a Sky Texture over all directions, about; elevation: of its sun, degrees."""
    rows = SKIES + DISCS if has_disc else SKIES
    return float(np.interp(air, AIR, [np.interp(elevation, ELEVATIONS, row) for row in rows]))
