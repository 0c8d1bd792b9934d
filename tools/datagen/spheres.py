# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles renders of one sphere under one environment: the training data of the material autoencoder.

    python -m tools.datagen.spheres OUT_DIR --spheres 3000 --first-seed 1

Follows docs/scene-input.md 3.6 (sphere, camera, film, parameter ranges), but 64x64 pixels, a sphere of 64x64 segments
and a studio light of Blender in place of the Uffizi map, which is not distributed. One seed is one sphere; finished
shards are kept.
"""
from __future__ import annotations

import argparse
import math
import os
import tempfile
import time
from pathlib import Path

import bpy
import numpy as np

from renderformer_v2.model.pictures import to_half
from tools.extension import run

from ..common.console import silence_blender
from .sample_files import save_arrays
from .scenes.worlds import load_studio_light

SIZE = 64
PER_SHARD = 250
INPUTS = ("base_r", "base_g", "base_b", "metallic", "roughness", "ior", "transmission")


def sphere_parameters(seed: int) -> np.ndarray:
    """(7,) f32 in the order of INPUTS; half of the spheres are opaque, the others have transmission U^0.7."""
    rng = np.random.default_rng(seed)
    base, metallic, ior = rng.uniform(size=3), rng.uniform(), rng.uniform(1.0, 2.5)
    roughness = 10.0 ** rng.uniform(-2.0, 0.0)
    transmission = rng.uniform() ** 0.7 if rng.uniform() < 0.5 else 0.0
    return np.array([*base, metallic, roughness, ior, transmission], np.float32)


def build_scene(samples: int) -> bpy.types.ShaderNode:
    """Replaces the open file by the sphere scene and returns its Principled BSDF."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.seed = samples, 0
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    scene.render.film_transparent = scene.render.use_persistent_data = True
    scene.render.threads_mode, scene.render.threads = "FIXED", os.cpu_count() or 1
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_mode, scene.render.image_settings.color_depth = "RGBA", "32"

    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=64, radius=1.0)
    sphere = bpy.context.object
    bpy.ops.object.shade_smooth()
    material = bpy.data.materials.new("sphere")
    material.use_nodes = True
    sphere.data.materials.append(material)

    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.location, camera.rotation_euler = (3.0, 0.0, 0.0), (math.pi / 2, 0.0, math.pi / 2)
    camera.data.angle = math.radians(39.6)
    scene.collection.objects.link(camera)
    scene.camera = camera

    scene.world = bpy.data.worlds.new("world")
    scene.world.use_nodes = True
    nodes, links = scene.world.node_tree.nodes, scene.world.node_tree.links
    texture = nodes.new("ShaderNodeTexEnvironment")
    texture.image = monochrome(load_studio_light("studio"))
    links.new(texture.outputs["Color"], nodes["Background"].inputs["Color"])
    return material.node_tree.nodes["Principled BSDF"]


def monochrome(image: bpy.types.Image) -> bpy.types.Image:
    """A float copy whose channels all hold the mean of RGB: a coloured light would be read as a coloured material."""
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    pixels = pixels.reshape(-1, 4)
    pixels[:, :3] = pixels[:, :3].mean(axis=1, keepdims=True)
    grey = bpy.data.images.new("grey", *image.size, float_buffer=True)
    grey.colorspace_settings.name = image.colorspace_settings.name
    grey.pixels.foreach_set(pixels.ravel())
    grey.pack()
    return grey


def set_parameters(shader: bpy.types.ShaderNode, values: np.ndarray) -> None:
    shader.inputs["Base Color"].default_value = (*map(float, values[:3]), 1.0)
    for name, value in zip(("Metallic", "Roughness", "IOR", "Transmission Weight"), values[3:], strict=True):
        shader.inputs[name].default_value = float(value)
    shader.inputs["Specular IOR Level"].default_value = 1.0


def render(path: str) -> np.ndarray:
    """(SIZE, SIZE, 3) f16, row 0 on top. Colour is premultiplied twice, as in the published data."""
    bpy.context.scene.render.filepath = path
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(path)
    pixels = np.empty(SIZE * SIZE * 4, np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    pixels = pixels.reshape(SIZE, SIZE, 4)[::-1]
    return to_half((pixels[..., :3] * pixels[..., 3:]).clip(0.0))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--spheres", type=int, default=3000)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--samples", type=int, default=16)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    silence_blender()
    shader, start = build_scene(args.samples), time.time()
    last = args.first_seed + args.spheres
    with tempfile.TemporaryDirectory() as folder:
        for first in range(args.first_seed, last, PER_SHARD):
            shard = args.out / f"spheres_{first:08d}.npz"
            if shard.exists():
                continue
            parameters = np.stack([sphere_parameters(s) for s in range(first, min(first + PER_SHARD, last))])
            images = []
            for values in parameters:
                set_parameters(shader, values)
                images.append(render(os.path.join(folder, "sphere.exr")))
            save_arrays(shard, {"parameters": parameters, "images": np.stack(images)})
            print(f"{shard.name}: {len(images)} spheres, {time.time() - start:.0f} s since the start", flush=True)
    return 0


if __name__ == "__main__":
    run(main)
