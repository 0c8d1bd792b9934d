# SPDX-License-Identifier: GPL-3.0-or-later
"""A room lit by one lamp, most of it by light that has bounced, rendered beside Cycles."""
import math

import bpy
import numpy as np

from tests.rf2_engine.f12 import material, mesh_object, press_f12

WHITE = (0.8, 0.8, 0.8)
WIDTH, DEPTH, HEIGHT = 2.5, 3.0, 3.0  # metres, the first to either side
SAMPLES = 64


def rectangle(scene, name, *corners, of=None):
    return mesh_object(scene, name, corners, [(0, 1, 2, 3)], of or material(name, WHITE))


def room(scene, **walls) -> None:
    """Floor, ceiling, left, right and back wall of a room that is open towards the camera; walls: their materials."""
    x, y, z = WIDTH, DEPTH, HEIGHT
    corners = {"floor": [(-x, -y, 0), (x, -y, 0), (x, y, 0), (-x, y, 0)],
               "ceiling": [(-x, -y, z), (-x, y, z), (x, y, z), (x, -y, z)],
               "left": [(-x, -y, 0), (-x, y, 0), (-x, y, z), (-x, -y, z)],
               "right": [(x, -y, 0), (x, -y, z), (x, y, z), (x, y, 0)],
               "back": [(-x, y, 0), (x, y, 0), (x, y, z), (-x, y, z)]}
    for name, places in corners.items():
        rectangle(scene, name, *places, of=walls.get(name))
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.02, 0.02, 0.02, 1)
    scene.camera.location = (0, -7, 1.5)
    scene.camera.data.lens = 35


def panel(scene, of, x=1.0, side=2.0):
    """A square that stands across the room, its front to the left."""
    half = side / 2
    return rectangle(scene, "Panel", (x, -half, 0.3), (x, -half, 0.3 + side), (x, half, 0.3 + side), (x, half, 0.3),
                     of=of)


def lamp(scene, location=(-1.5, 0, 2.5), turn=(0, -math.pi / 3, 0), energy=150, kind="AREA"):
    """An area lamp that shines to the right, if not said otherwise."""
    light = bpy.data.lights.new("Lamp", kind)
    light.energy = energy
    added = bpy.data.objects.new("Lamp", light)
    added.location, added.rotation_euler = location, turn
    scene.collection.objects.link(added)
    return added


def by_ray(name, rays, first, second):
    """A material that mixes two shaders by what Light Path says of `rays`: the second one is for these.

    Shaders: (kind, inputs).
    """
    made = material(name)
    tree = made.node_tree
    tree.nodes.clear()
    mix, path, output = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("MixShader", "LightPath", "OutputMaterial"))
    for i, (kind, inputs) in enumerate((first, second), 1):
        shader = tree.nodes.new(f"ShaderNode{kind}")
        for key, value in inputs.items():
            shader.inputs[key].default_value = value
        tree.links.new(shader.outputs[0], mix.inputs[i])
    factor = path.outputs[rays[0]]
    for ray in rays[1:]:
        either = tree.nodes.new("ShaderNodeMath")
        either.operation = "MAXIMUM"
        for i, socket in enumerate((factor, path.outputs[ray])):
            tree.links.new(socket, either.inputs[i])
        factor = either.outputs[0]
    tree.links.new(factor, mix.inputs[0])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    return made


def beside_cycles(scene, tmp_path) -> tuple[np.ndarray, np.ndarray]:
    """(H, W, 3) our picture and Cycles'."""
    scene.render.resolution_x, scene.render.resolution_y = 48, 32
    scene.renderformer_v2.guide_samples = 32
    scene.renderformer_v2.max_edge = 0.1
    scene.cycles.sample_clamp_indirect = 0
    chosen = scene.renderformer_v2.reference
    chosen.use, chosen.samples, chosen.use_denoising = True, SAMPLES, True
    passes = press_f12(scene, tmp_path)
    return passes["ViewLayer.Combined"][..., :3], passes["ViewLayer.Cycles Reference"][..., :3]


def assert_alike(ours, cycles, rtol=0.06, atol=0.004, blocks=4) -> None:
    """The means of blocks x blocks parts of both pictures are the same."""
    height, width, _ = ours.shape
    means = [picture.reshape(blocks, height // blocks, blocks, width // blocks, 3).mean((1, 3))
             for picture in (ours, cycles)]
    np.testing.assert_allclose(*means, rtol=rtol, atol=atol)


def remarks() -> str:
    """What Last Render says."""
    from bl_ext.user_default.renderformer_v2.rf2_engine.progress.last_render import last_frame
    return "\n".join(line for layer in last_frame for line in layer.report)
