# SPDX-License-Identifier: GPL-3.0-or-later
"""Worlds of the wide profile: Sky Textures, alone or with a sun lamp, and panoramas that are made up."""
from __future__ import annotations

import bpy
import numpy as np

from mathutils import Vector

from renderformer_v2.model.geometry import latlong_directions
from renderformer_v2.model.scene import ENVIRONMENT_SHAPE

from .environments import link_panorama, new_world

SUN_LAMP = 0.6  # chance that a sky's sun is a lamp and not a disc in the sky
WAVES = 24      # that make the clouds

# Mean radiance over all directions of Blender 4.5's Sky Texture, and of the sun in it, by air density and elevation.
AIR, ELEVATIONS = (0.5, 1, 2, 3), (2, 5, 10, 20, 40, 80)
SKIES = np.array([(0.89, 1.52, 1.99, 2.03, 1.71, 1.41), (0.63, 1.22, 1.84, 2.20, 2.14, 1.93),
                  (0.38, 0.84, 1.50, 2.16, 2.48, 2.46), (0.27, 0.62, 1.22, 1.97, 2.51, 2.66)])
DISCS = np.array([(1.73, 4.25, 6.70, 8.73, 9.99, 10.55), (0.76, 2.53, 4.89, 7.33, 9.06, 9.89),
                  (0.19, 1.07, 2.84, 5.32, 7.53, 8.73), (0.05, 0.51, 1.76, 3.98, 6.33, 7.74)])


def build_sky(rng: np.random.Generator, irradiance: float) -> None:
    """A Sky Texture, its sun 2 to 80 degrees high, as a disc or as a lamp that brings 30 to 80 % of the irradiance."""
    world, background = new_world()
    sky = world.node_tree.nodes.new("ShaderNodeTexSky")
    elevation, turn = np.radians(rng.uniform(2, 80)), rng.uniform(-np.pi, np.pi)
    sky.sun_elevation, sky.sun_rotation, sky.air_density = elevation, turn, rng.uniform(0.5, 3.0)
    world.node_tree.links.new(sky.outputs["Color"], background.inputs["Color"])
    share = rng.uniform(0.3, 0.8) if rng.uniform() < SUN_LAMP else 0.0
    sky.sun_disc = not share
    if share:
        toward = [np.sin(turn) * np.cos(elevation), np.cos(turn) * np.cos(elevation), np.sin(elevation)]
        add_sun(rng, Vector(toward), share * irradiance)
    mean = _mean_radiance(np.degrees(elevation), sky.air_density, sky.sun_disc)
    background.inputs["Strength"].default_value = (1 - share) * irradiance / np.pi / mean


def add_sun(rng: np.random.Generator, toward: Vector, irradiance: float) -> None:
    data = bpy.data.lights.new("sun", "SUN")
    data.energy, data.angle = irradiance, np.radians(rng.uniform(0.5, 5))
    data.color = 1.0, rng.uniform(0.7, 1.0), rng.uniform(0.5, 1.0)
    sun = bpy.data.objects.new("sun", data)
    sun.rotation_euler = toward.to_track_quat("Z", "Y").to_euler()
    bpy.context.scene.collection.objects.link(sun)


def build_panorama(rng: np.random.Generator, radiance: float) -> None:
    """A made-up panorama of this mean radiance."""
    world, background = new_world()
    height, width, _ = ENVIRONMENT_SHAPE
    image = bpy.data.images.new("panorama", width, height, float_buffer=True)
    image.colorspace_settings.name = "Linear Rec.709"
    pixels = np.ones((height, width, 4), np.float32)
    pixels[..., :3] = panorama(rng)[::-1]
    rows = np.sin(np.pi * (np.arange(height) + 0.5) / height)
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    link_panorama(world, background, image, (0.0, 0.0, rng.uniform(-np.pi, np.pi)))
    mean = np.average(pixels[..., :3].mean(axis=(1, 2)), weights=rows)
    background.inputs["Strength"].default_value = radiance / float(mean)


def panorama(rng: np.random.Generator) -> np.ndarray:
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
    light = ground + np.clip(0.5 + up * sharp, 0, 1) * (sky - ground)
    for _ in range(int(rng.integers(0, 6))):
        axis = rng.normal(size=3) + (0, 0, 0.7)
        narrow = 10 ** rng.uniform(0.5, 3.3)  # lobe 45 to 2 degrees wide
        spot = np.exp(narrow * (toward @ (axis / np.linalg.norm(axis)) - 1))[..., None]
        light = light + spot * rng.uniform(0.3, 1.0, 3) * narrow ** rng.uniform(0.2, 1.0)
    return light.astype(np.float32)


def _mean_radiance(elevation: float, air: float, disc: bool) -> float:
    """Of a Sky Texture over all directions, about; elevation of its sun in degrees."""
    rows = SKIES + DISCS if disc else SKIES
    return float(np.interp(air, AIR, [np.interp(elevation, ELEVATIONS, row) for row in rows]))
