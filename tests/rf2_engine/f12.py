# SPDX-License-Identifier: GPL-3.0-or-later
"""Press F12 and read what a user would find in the saved multilayer EXR."""
import bpy
import numpy as np
import OpenEXR

from bl_ext.user_default.renderformer_v2.rf2_engine import compat


def press_f12(scene, tmp_path, may_fail=False) -> dict[str, np.ndarray]:
    """{"ViewLayer.Combined": (H, W, C) f32, ...}, row 0 on top. `may_fail` saves the frame of a failed render too."""
    try:
        bpy.ops.render.render(scene=scene.name)
    except RuntimeError:
        if not may_fail:
            raise
    path = tmp_path / "picture.exr"
    compat.set_file_format(scene.render.image_settings, "OPEN_EXR_MULTILAYER")
    scene.render.image_settings.color_depth = "32"
    bpy.data.images["Render Result"].save_render(str(path), scene=scene)
    return read_exr(path)


def read_exr(path) -> dict[str, np.ndarray]:
    """The passes of a multilayer EXR file, as `press_f12` returns them."""
    with OpenEXR.File(str(path)) as file:
        return _joined({name: channel.pixels for name, channel in file.channels().items()})


def _joined(channels: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Passes from channels: the reader joins RGB(A) by itself, but leaves X, Y, Z apart."""
    passes = {}
    for name, pixels in channels.items():
        stem, _, last = name.rpartition(".")
        if len(last) == 1:
            passes.setdefault(stem, {})[last] = pixels
        else:
            passes[name] = pixels
    return {name: np.stack([parts[k] for k in sorted(parts)], -1) if isinstance(parts, dict) else parts
            for name, parts in passes.items()}


def material(name, color=(0.8, 0.8, 0.8)):
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    made.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (*color, 1)
    return made


def glass(ior):
    """Smooth and clear."""
    made = material("Glass", (1, 1, 1))
    inputs = made.node_tree.nodes["Principled BSDF"].inputs
    inputs["Roughness"].default_value, inputs["IOR"].default_value = 0, ior
    inputs["Transmission Weight"].default_value = 1
    return made


def volume_material(name, kind, inputs):
    """Of a medium without a surface; kind: of its node, inputs: their values by name."""
    made = material(name)
    tree = made.node_tree
    tree.nodes.clear()
    medium, output = (tree.nodes.new(f"ShaderNode{node}") for node in (kind, "OutputMaterial"))
    for key, value in inputs.items():
        medium.inputs[key].default_value = value
    tree.links.new(medium.outputs[0], output.inputs["Volume"])
    return made


def mesh_object(scene, name, vertices, faces, of=None):
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, [], faces)
    mesh.materials.append(of or material(name))
    added = bpy.data.objects.new(name, mesh)
    scene.collection.objects.link(added)
    return added


def cube(scene, name="Cube", location=(0, 0, 0), of=None):
    corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    added = mesh_object(scene, name, corners, faces, of)
    added.location = location
    return added


def sun(scene, rotation=(0.9, 0.2, 0.4)):
    light = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    light.data.energy = 3
    light.rotation_euler = rotation
    scene.collection.objects.link(light)
    return light
