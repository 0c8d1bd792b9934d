# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles renders of one sphere under one environment: the training data of the material autoencoder and the mappers.

    python -m tools.datagen.spheres OUT_DIR --spheres 3000 --first-seed 1

Each mapper has its own kind of material and folder in OUT_DIR. Follows docs/scene-input.md 3.2 and 3.6 (shaders,
sphere, camera, film, parameter ranges), but 64x64 pixels, a sphere of 64x64 segments and a studio light of Blender in
place of the Uffizi map, which is not distributed. One seed is one sphere; finished shards are kept.
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

from renderformer_v2.model.material.mappers import PAPER_IOR
from renderformer_v2.model.pictures import to_half
from tools.extension import run

from ..common.console import silence_blender
from .sample_files import save_arrays
from .scenes.worlds import load_studio_light

SIZE = 64
PER_SHARD = 250
BLACK = 0.3  # chance that a material of diffuse and specular has no specular


def draw_parameters(mapper: str, seed: int) -> np.ndarray:
    """What a mapper takes, f32 in its order; `mapper` is a name of material.mappers.MAPPERS."""
    return PARAMETERS[mapper](np.random.default_rng(seed)).astype(np.float32)


def draw_diffuse_specular(rng: np.random.Generator) -> np.ndarray:
    """Diffuse and specular RGB, which reflect no more than arrives, and roughness."""
    colors = rng.uniform(size=(2, 3)) * [[1], [rng.uniform() > BLACK]]
    return np.array([*(colors / max(colors.sum(0).max(), 1)).ravel(), draw_roughness(rng)])


def draw_metallic(rng: np.random.Generator) -> np.ndarray:
    """Base RGB, metallic, roughness."""
    return np.array([*rng.uniform(size=4), draw_roughness(rng)])


def draw_transmission(rng: np.random.Generator) -> np.ndarray:
    """Base RGB, metallic, roughness, IOR, transmission: half are opaque, the others have transmission U^0.7."""
    base, metallic, ior = rng.uniform(size=3), rng.uniform(), rng.uniform(1.0, 2.5)
    roughness = draw_roughness(rng)
    transmission = rng.uniform() ** 0.7 if rng.uniform() < 0.5 else 0.0
    return np.array([*base, metallic, roughness, ior, transmission])


def draw_roughness(rng: np.random.Generator) -> float:
    return 10.0 ** rng.uniform(-2.0, 0.0)


PARAMETERS = {"diffspec_mapper": draw_diffuse_specular, "metallic_mapper": draw_metallic,
              "metallic_transmission_mapper": draw_transmission}


def build_scene(samples: int) -> bpy.types.ShaderNodeTree:
    """Replaces the open file by the sphere scene and returns the nodes of its material."""
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
    return material.node_tree


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


def set_parameters(tree: bpy.types.ShaderNodeTree, mapper: str, values: np.ndarray) -> None:
    """Make the material what the mapper means by these values (docs/scene-input.md 3.2)."""
    values, output = [float(value) for value in values], tree.nodes["Material Output"].inputs["Surface"]
    if mapper == "diffspec_mapper":
        lobes = [tree.nodes.get(kind) or tree.nodes.new(f"ShaderNodeBsdf{kind}") for kind in ("Diffuse", "Glossy")]
        added = tree.nodes.get("Both") or tree.nodes.new("ShaderNodeAddShader")
        for i, (lobe, kind) in enumerate(zip(lobes, ("Diffuse", "Glossy"), strict=True)):
            lobe.name, lobe.inputs["Color"].default_value = kind, (*values[3 * i:3 * i + 3], 1.0)
            tree.links.new(lobe.outputs[0], added.inputs[i])
        added.name, lobes[1].inputs["Roughness"].default_value = "Both", values[6]
        tree.links.new(added.outputs[0], output)
        return
    shader = tree.nodes["Principled BSDF"]
    tree.links.new(shader.outputs[0], output)
    shader.inputs["Base Color"].default_value = (*values[:3], 1.0)
    rest = [*values[3:], *(PAPER_IOR, 0.0)][:4]
    for name, value in zip(("Metallic", "Roughness", "IOR", "Transmission Weight"), rest, strict=True):
        shader.inputs[name].default_value = value
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


def make_shards(folder: Path, mapper: str, seeds: range, tree: bpy.types.ShaderNodeTree) -> None:
    """The spheres of `seeds` that are not in the folder yet, PER_SHARD in a file."""
    folder.mkdir(parents=True, exist_ok=True)
    start = time.time()
    with tempfile.TemporaryDirectory() as pictures:
        for first in seeds[::PER_SHARD]:
            shard = folder / f"spheres_{first:08d}.npz"
            if shard.exists():
                continue
            some = range(first, min(first + PER_SHARD, seeds.stop))
            parameters, images = np.stack([draw_parameters(mapper, seed) for seed in some]), []
            for values in parameters:
                set_parameters(tree, mapper, values)
                images.append(render(os.path.join(pictures, "sphere.exr")))
            save_arrays(shard, {"parameters": parameters, "images": np.stack(images)})
            print(f"{mapper}, {shard.name}: {len(images)} spheres, {time.time() - start:.0f} s since the start",
                  flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.datagen.spheres", description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--mappers", nargs="+", choices=PARAMETERS, default=list(PARAMETERS), metavar="NAME",
                        help=f"whose materials, of {', '.join(PARAMETERS)} (default: all)")
    parser.add_argument("--spheres", type=int, default=3000, help="for each mapper")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--samples", type=int, default=16)
    args = parser.parse_args()
    silence_blender()
    tree = build_scene(args.samples)
    for mapper in args.mappers:
        make_shards(args.out / mapper, mapper, range(args.first_seed, args.first_seed + args.spheres), tree)
    return 0


if __name__ == "__main__":
    run(main)
