# SPDX-License-Identifier: GPL-3.0-or-later
"""Worlds of the wide profile: Sky Textures, alone or with a sun lamp, and panoramas that are made up."""
from __future__ import annotations

import bpy
import numpy as np

from mathutils import Vector

from renderformer_v2.model.geometry import latlong_directions
from renderformer_v2.model.scene import ENVIRONMENT_SHAPE
from renderformer_v2.rf2_engine.convert.copying.blocks import Blocks
from renderformer_v2.rf2_engine.convert.report import Report
from renderformer_v2.rf2_engine.convert.world import convert_world

from .environments import link_panorama, new_world

SUN_LAMP = 0.6  # chance that a sky's sun is a lamp and not a disc in the sky
WAVES = 24      # that make the clouds


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
    _brighten(world, background, (1 - share) * irradiance / np.pi)


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
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    link_panorama(world, background, image, (0.0, 0.0, rng.uniform(-np.pi, np.pi)))
    _brighten(world, background, radiance)


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


def _brighten(world: bpy.types.World, background: bpy.types.ShaderNode, radiance: float) -> None:
    """Set the strength that makes the mean over all directions `radiance`."""
    background.inputs["Strength"].default_value = 1.0
    seen = convert_world(Blocks(bpy.context.scene.frame_current).of(world), Report())
    rows = np.sin(np.pi * (np.arange(len(seen)) + 0.5) / len(seen))
    background.inputs["Strength"].default_value = radiance / float(np.average(seen.mean(axis=(1, 2)), weights=rows))
