# SPDX-License-Identifier: GPL-3.0-or-later
"""Numbers measured in Cycles, for the tests of this folder: irradiance at a point, and shaders seen flat on."""
import math
import os

import bpy
import numpy as np

from mathutils import Matrix, Vector


def empty_cycles_scene(samples=256):
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_adaptive_sampling, scene.cycles.use_denoising = samples, False, False
    scene.cycles.max_bounces, scene.cycles.light_sampling_threshold = 0, 0
    scene.render.resolution_x = scene.render.resolution_y = 4
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    return scene


def material(shader="ShaderNodeBsdfPrincipled", name="Material", **inputs):
    """(material, node tree, shader node); `inputs` are input names with _ for blanks."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    node, output = tree.nodes.new(shader), tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(node.outputs[0], output.inputs["Surface"])
    for key, value in inputs.items():
        node.inputs[key.replace("_", " ")].default_value = value
    return made, tree, node


def world():
    """(world, node tree, Background node), made the scene's world."""
    made = bpy.data.worlds.new("World")
    made.use_nodes = True
    made.cycles.sampling_method, made.cycles.sample_map_resolution = "MANUAL", 512  # the automatic map takes seconds
    bpy.context.scene.world = made
    return made, made.node_tree, made.node_tree.nodes["Background"]


def lamp(kind, matrix, **settings):
    light = bpy.data.lights.new("Lamp", kind)
    for key, value in settings.items():
        setattr(light, key, value)
    obj = bpy.data.objects.new("Lamp", light)
    obj.matrix_world = matrix
    bpy.context.scene.collection.objects.link(obj)
    return obj


def irradiance(point, normal):
    """(3,) irradiance that Cycles' lamps and world give to a small white plane."""
    white, _, _ = material("ShaderNodeBsdfDiffuse", "White", Color=(1, 1, 1, 1))
    turn = Vector(normal).normalized().to_track_quat("Z", "Y").to_matrix().to_4x4()
    frame = Matrix.Translation(point) @ turn
    return math.pi * seen_flat_on(white, 0.02, frame=frame).mean(axis=(0, 1))


def seen_flat_on(shader, side, uv=None, frame=None, resolution=None):
    """(H, W, 3) picture, row 0 at the bottom, of the middle half of a square plane of this side wearing `shader`.

    uv: (4, 2) at its corners, counter-clockwise from the lower left.
    """
    half, frame = side / 2, frame or Matrix()
    mesh = bpy.data.meshes.new("Plane")
    mesh.from_pydata([(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)], [], [(0, 1, 2, 3)])
    if uv is not None:
        mesh.uv_layers.new(name="UVMap").data.foreach_set("uv", np.ravel(uv))
    mesh.materials.append(shader)
    plane = bpy.data.objects.new("Plane", mesh)
    plane.matrix_world = frame
    bpy.context.scene.collection.objects.link(plane)
    pixels = pictured(half, half, frame, resolution, clip_start=0.9 * half)
    bpy.data.objects.remove(plane)
    return pixels


def pictured(side, height, frame=None, resolution=None, clip_start=1e-4):
    """(H, W, 3) picture, row 0 at the bottom, of what is below a square of this side, looked at from `height`."""
    scene, frame = bpy.context.scene, frame or Matrix()
    if resolution:
        scene.render.resolution_x = scene.render.resolution_y = resolution
    data = bpy.data.cameras.new("Camera")
    data.type, data.ortho_scale, data.clip_start = "ORTHO", side, clip_start
    camera = bpy.data.objects.new("Camera", data)
    camera.matrix_world = frame @ Matrix.Translation((0, 0, height))
    scene.collection.objects.link(camera)
    scene.camera = camera
    pixels = rendered(scene)
    bpy.data.objects.remove(camera)
    return pixels


def rendered(scene):
    """(H, W, 3) picture, row 0 at the bottom."""
    scene.render.filepath = os.path.join(bpy.app.tempdir, "reference.exr")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath)
    pixels = np.array(image.pixels[:], np.float32).reshape(image.size[1], image.size[0], -1)[..., :3]
    bpy.data.images.remove(image)
    return pixels
