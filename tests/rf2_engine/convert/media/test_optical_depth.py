# SPDX-License-Identifier: GPL-3.0-or-later
"""Optical depth along test rays: media of every kind side by side above a bright background, tokens against Cycles."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.geometry import rotation_matrix
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.copying import vdb

from tests.rf2_engine.convert.cycles_reference import empty_cycles_scene, pictured, world

SIDE, PATCHES, PIXELS = 2.0, 2, 7  # metres; squares along either side of the picture, and pixels of these
STEP = 0.005                       # metres along the rays
COLOR = (0.3, 0.6, 0.9, 1)
MEDIA = {}


def medium(function):
    """A function that, given a folder, adds a medium around the origin, no wider than SIDE, and returns its object."""
    MEDIA[function.__name__] = function
    return function


def material(kind, **inputs):
    """(material, node tree, volume shader)"""
    made = bpy.data.materials.new("Medium")
    made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    node, output = tree.nodes.new(f"ShaderNode{kind}"), tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(node.outputs[0], output.inputs["Volume"])
    for name, value in inputs.items():
        node.inputs[name.replace("_", " ")].default_value = value
    return made, tree, node


def principled(density):
    return material("VolumePrincipled", Density=density, Color=COLOR)[0]


def varied(node, ways):
    """A volume absorption whose density is an output of a node, through the given values of Map Range."""
    made, tree, shader = material("VolumeAbsorption", Color=COLOR)
    source, span = tree.nodes.new(f"ShaderNode{node[0]}"), tree.nodes.new("ShaderNodeMapRange")
    for name, value in ways.items():
        span.inputs[name].default_value = value
    tree.links.new(source.outputs[node[1]], span.inputs["Value"])
    tree.links.new(span.outputs[0], shader.inputs["Density"])
    return made


def gridded(folder, shader, voxel=0.05, **grids):
    """A Volume object around the origin with grids of these values."""
    openvdb, made, name = vdb.openvdb_module(), [], f"{len(bpy.data.volumes)}.vdb"
    for key, values in grids.items():
        grid = openvdb.FloatGrid(0.0) if values.ndim == 3 else openvdb.Vec3SGrid((0.0, 0.0, 0.0))
        grid.copyFromArray(values.astype(np.float32))
        grid.name, grid.transform = key, openvdb.createLinearTransform(voxelSize=voxel)
        grid.transform.postTranslate([-s * voxel / 2 for s in values.shape[:3]])
        made.append(grid)
    openvdb.write(str(folder / name), made)
    volume = bpy.data.volumes.new("Cloud")
    volume.filepath = str(folder / name)
    volume.materials.append(shader)
    obj = bpy.data.objects.new("Cloud", volume)
    bpy.context.scene.collection.objects.link(obj)
    return obj


def blob(size, sharp=4.0):
    place = (np.indices(size).transpose(1, 2, 3, 0) + 0.5) / size * 2 - 1
    return np.exp(-sharp * (place ** 2).sum(axis=-1))


@medium
def ball(folder):
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.9)
    bpy.context.object.data.materials.append(principled(0.7))
    return bpy.context.object


@medium
def wedge(folder):
    """A turned box, denser towards the right."""
    bpy.ops.mesh.primitive_cube_add(size=1.2, rotation=(0.3, 0.2, 0.1), scale=(1, 0.8, 0.7))
    made = varied(("SeparateXYZ", "X"), {"To Max": 3.0})
    tree = made.node_tree
    tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs["Generated"], tree.nodes["Separate XYZ"].inputs[0])
    bpy.context.object.data.materials.append(made)
    return bpy.context.object


@medium
def marble(folder):
    """A cube with a noise inside."""
    bpy.ops.mesh.primitive_cube_add(size=SIDE * (1 - 1 / PIXELS))
    made = varied(("TexNoise", 0), {"From Min": 0.3, "From Max": 0.7, "To Max": 2.0})
    made.node_tree.nodes["Noise Texture"].inputs["Scale"].default_value = 4
    bpy.context.object.data.materials.append(made)
    return bpy.context.object


@medium
def cloud(folder):
    """A grid that fades out slowly."""
    return gridded(folder, principled(2.0), density=blob((40, 40, 40)))


@medium
def dense(folder):
    """A long grid of many voxels, so dense that what is thin in it counts too; turned and scaled."""
    obj = gridded(folder, principled(40.0), 0.01, density=blob((150, 100, 70), 8.0))
    obj.rotation_euler, obj.scale = (0.4, 0.2, 0.5), (1.2, 1.2, 0.8)
    return obj


@medium
def coarse(folder):
    """A grid of few voxels, mirrored, whose shader knows another one."""
    obj = gridded(folder, varied(("Attribute", "Fac"), {"To Max": 2.0}), 0.3,
                  density=np.ones((2, 2, 2)), smoke=np.arange(60).reshape(5, 4, 3) / 60)
    obj.data.materials[0].node_tree.nodes["Attribute"].attribute_name = "smoke"
    obj.scale.x = -1
    return obj


def background_left(volumes, side=SIDE, from_height=1.5):
    """(PATCHES, PATCHES, 3) means over vertical rays from a height through a square of the ground, or from above it."""
    count = 2 * PATCHES * PIXELS
    across = ((np.arange(count) + 0.4987) / count - 0.5) * side  # not along the borders of voxels
    rays = np.stack(np.meshgrid(across, across), axis=-1).reshape(-1, 2)
    heights = np.arange(0 if from_height < 1.5 else -1.5, from_height, STEP)
    depth = np.zeros((len(rays), 3))
    for i in range(len(volumes)):
        scale, place = volumes.scale[i].astype(float), volumes.position[i]
        near = np.flatnonzero(np.linalg.norm(rays - place[:2], axis=1) < np.linalg.norm(scale) / 16)
        inner = heights[np.abs(heights - place[2]) < np.linalg.norm(scale) / 16]
        points = np.concatenate([np.repeat(rays[near, None], len(inner), axis=1),
                                 np.broadcast_to(inner[:, None], (len(near), len(inner), 1))], axis=2)
        local = (points - place) @ rotation_matrix(volumes.rotation[i]) / scale * 8 + 0.5
        x, y, z = np.moveaxis((local * 4).astype(int).clip(0, 3), -1, 0)
        inside = ((local >= 0) & (local < 1)).all(axis=-1)
        density = (volumes.density[i].reshape(4, 4, 4)[z, y, x] * inside).sum(axis=1) * STEP
        depth[near] += density[:, None] * (volumes.scattering[i] + volumes.absorption[i]) / np.sqrt(np.mean(scale ** 2))
    return patches(np.exp(-depth).reshape(count, count, 3))


def patches(picture):
    return picture.reshape(PATCHES, -1, PATCHES, len(picture) // PATCHES, 3).mean(axis=(1, 3))


@pytest.mark.parametrize("name", MEDIA)
def test_optical_depth_is_as_in_cycles(converted, report, tmp_path, name):
    scene = empty_cycles_scene(samples=64)
    scene.cycles.volume_step_rate = 0.3
    if hasattr(scene.cycles, "volume_biased"):  # quicker, and as it was before Blender 5
        scene.cycles.volume_biased = True
    made, _, background = world()
    background.inputs["Color"].default_value = (1, 1, 1, 1)
    made.cycles_visibility.scatter = False  # nothing is lit, so that what is seen is what is left
    MEDIA[name](tmp_path)
    bpy.context.view_layer.update()
    found = background_left(converted().volumes)
    measured = patches(pictured(SIDE, height=3, resolution=PATCHES * PIXELS))
    assert measured.max() < 0.99
    np.testing.assert_allclose(np.log(found), np.log(measured), rtol=0.05)
    assert all("ray visibility" in message for _, _, message in report.entries)
