# SPDX-License-Identifier: GPL-3.0-or-later
"""How much of a bright background is left behind media: cells of tokens against Cycles."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.geometry import rotation_matrix
from bl_ext.user_default.renderformer_v2.rf2_engine.convert import vdb

from tests.rf2_engine.convert.cycles_reference import empty_cycles_scene, pictured, world

HALF, STEPS = 0.6, np.linspace(-1.5, 1.5, 400)  # metres: of the square looked through, and along the rays


def background_left(volumes):
    """(3,) mean over vertical rays through the square."""
    across = ((np.arange(6) + 0.5) / 6 * 2 - 1) * HALF
    rays = np.stack(np.meshgrid(across, across), axis=-1).reshape(-1, 2)
    points = np.concatenate([np.repeat(rays[:, None], len(STEPS), axis=1),
                             np.broadcast_to(STEPS[:, None], (len(rays), len(STEPS), 1))], axis=2)
    depth = np.zeros((len(rays), 3))
    for i in range(len(volumes)):
        scale = volumes.scale[i].astype(float)
        near = np.linalg.norm(rays - volumes.position[i, :2], axis=1) < np.linalg.norm(scale) / 16
        local = (points[near] - volumes.position[i]) @ rotation_matrix(volumes.rotation[i]) / scale * 8 + 0.5
        x, y, z = np.moveaxis((local * 4).astype(int).clip(0, 3), -1, 0)
        inside = ((local >= 0) & (local < 1)).all(axis=-1)
        density = (volumes.density[i].reshape(4, 4, 4)[z, y, x] * inside).sum(axis=1) * (STEPS[1] - STEPS[0])
        extinction = (volumes.scattering[i] + volumes.absorption[i]) / np.sqrt(np.mean(scale ** 2))
        depth[near] += density[:, None] * extinction
    return np.exp(-depth).mean(axis=0)


def shader(kind, **inputs):
    material = bpy.data.materials.new("Medium")
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    node, output = tree.nodes.new(kind), tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(node.outputs[0], output.inputs["Volume"])
    for name, value in inputs.items():
        node.inputs[name.replace("_", " ")].default_value = value
    return material, tree, node


def ball(folder):
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.9)
    bpy.context.object.data.materials.append(
        shader("ShaderNodeVolumePrincipled", Density=0.7, Color=(0.2, 0.5, 0.9, 1))[0])


def wedge(folder):
    """A turned box, denser towards the right."""
    bpy.ops.mesh.primitive_cube_add(size=2, rotation=(0.3, 0.2, 0.1), scale=(1, 0.8, 0.7))
    material, tree, node = shader("ShaderNodeVolumeAbsorption", Color=(0.2, 0.5, 0.8, 1))
    names = ("TexCoord", "SeparateXYZ", "Math")
    coordinate, separate, thrice = (tree.nodes.new("ShaderNode" + name) for name in names)
    thrice.operation, thrice.inputs[1].default_value = "MULTIPLY", 2.0
    for start, end in ((coordinate.outputs["Generated"], separate.inputs[0]),
                       (separate.outputs["X"], thrice.inputs[0]), (thrice.outputs[0], node.inputs["Density"])):
        tree.links.new(start, end)
    bpy.context.object.data.materials.append(material)


def cloud(folder):
    """A grid that fades out slowly."""
    openvdb = vdb.openvdb_module()
    place = np.indices((40, 40, 40)).transpose(1, 2, 3, 0) / 39 * 2 - 1
    grid = openvdb.FloatGrid(0.0)
    grid.copyFromArray(np.exp(-4 * (place ** 2).sum(axis=-1)).astype(np.float32))
    grid.name = "density"
    grid.transform = openvdb.createLinearTransform(voxelSize=2 / 40)
    openvdb.write(str(folder / "cloud.vdb"), [grid])
    volume = bpy.data.volumes.new("Cloud")
    volume.filepath = str(folder / "cloud.vdb")
    volume.materials.append(shader("ShaderNodeVolumePrincipled", Density=2.0, Color=(0.3, 0.6, 0.9, 1))[0])
    obj = bpy.data.objects.new("Cloud", volume)
    obj.location = (-1, -1, -1)
    bpy.context.scene.collection.objects.link(obj)


@pytest.mark.parametrize("add, tolerance", [(ball, 0.05), (wedge, 0.05), (cloud, 0.15)])
def test_optical_depth_is_as_in_cycles(converted, report, tmp_path, add, tolerance):
    scene = empty_cycles_scene(samples=64)
    scene.cycles.volume_step_rate = 0.3
    made, _, background = world()
    background.inputs["Color"].default_value = (1, 1, 1, 1)
    made.cycles_visibility.scatter = False  # nothing is lit, so that what is seen is what is left
    add(tmp_path)
    bpy.context.view_layer.update()
    found = background_left(converted().volumes)
    measured = pictured(2 * HALF, height=3, resolution=12).mean(axis=(0, 1))
    assert measured.max() < 0.9
    np.testing.assert_allclose(np.log(found), np.log(measured), rtol=tolerance)
    assert all("ray visibility" in message for _, _, message in report.entries)
