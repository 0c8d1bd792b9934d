# SPDX-License-Identifier: GPL-3.0-or-later
"""Optical depth along rays through the cells of volumes is that of Cycles: meshes and a grid, turned and scaled."""
import os

import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.convert import vdb
from mathutils import Euler

from .cycles_reference import empty_cycles_scene, world

SIZE, WIDTH, STEPS = 16, 3.0, 100  # pixels and world units of a square picture, points along a ray
DENSITY = 0.8


def absorbing() -> bpy.types.Material:
    made = bpy.data.materials.new("Smoke")
    made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    shader, output = tree.nodes.new("ShaderNodeVolumePrincipled"), tree.nodes.new("ShaderNodeOutputMaterial")
    shader.inputs["Color"].default_value, shader.inputs["Density"].default_value = (0, 0, 0, 1), DENSITY
    tree.links.new(shader.outputs[0], output.inputs["Volume"])
    return made


def box(folder):
    bpy.ops.mesh.primitive_cube_add(size=1.5, rotation=(0.4, 0.2, 0.6))


def egg(folder):
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.8, scale=(1, 1, 1.5), rotation=(0.5, 0, 0))


def grid(folder):
    openvdb = vdb.openvdb_module()
    made = openvdb.FloatGrid(0.0)
    made.copyFromArray(np.linspace(1.2, 2, 24 ** 3).reshape(24, 24, 24).astype(np.float32))
    made.name = "density"
    made.transform = openvdb.createLinearTransform(
        [[1 / 24, 0, 0, 0], [0, 1 / 24, 0, 0], [0, 0, 1 / 24, 0], [-0.5, -0.5, -0.5, 1]])
    openvdb.write(str(folder / "grid.vdb"), [made])
    data = bpy.data.volumes.new("Smoke")
    data.filepath = str(folder / "grid.vdb")
    obj = bpy.data.objects.new("Smoke", data)
    obj.rotation_euler, obj.scale = (0.3, 0.2, 0.5), (1.6, 1.6, 1.6)
    bpy.context.scene.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj


def of_cycles() -> np.ndarray:
    """(SIZE, SIZE) optical depths along +Y, row 0 at the bottom."""
    scene = bpy.context.scene
    _, _, background = world()
    background.inputs["Color"].default_value, background.inputs["Strength"].default_value = (1, 1, 1, 1), 1
    data = bpy.data.cameras.new("Camera")
    data.type, data.ortho_scale = "ORTHO", WIDTH
    camera = bpy.data.objects.new("Camera", data)
    camera.location, camera.rotation_euler = (0, -5, 0), (np.pi / 2, 0, 0)
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    if hasattr(scene.cycles, "volume_biased"):
        scene.cycles.volume_biased = True  # else Cycles 5 decides by chance where a ray through smoke ends
    scene.render.filepath = os.path.join(bpy.app.tempdir, "depth.exr")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath)
    return -np.log(np.maximum(np.array(image.pixels[:]).reshape(SIZE, SIZE, -1)[..., 0], 1e-6))


def of_cells(volumes) -> np.ndarray:
    """The same through the tokens (docs/scene-input.md 5.4)."""
    side = (np.arange(SIZE) + 0.5) / SIZE * WIDTH - WIDTH / 2
    along, step = np.linspace(-WIDTH / 2, WIDTH / 2, STEPS, retstep=True)
    z, x, y = np.meshgrid(side, side, along, indexing="ij")
    points, extinction = np.stack([x, y, z], axis=-1), np.zeros(x.shape)
    for cell in range(len(volumes)):
        turn = np.array(Euler(volumes.rotation[cell]).to_matrix())
        voxel = np.floor(((points - volumes.position[cell]) @ turn / volumes.scale[cell] * 32) + 2).astype(int)
        inside = ((voxel >= 0) & (voxel < 4)).all(axis=-1)
        density = volumes.density[cell].reshape(4, 4, 4)[tuple(voxel[inside][:, ::-1].T)]
        coefficient = (volumes.scattering + volumes.absorption)[cell, 0] / np.sqrt(np.mean(volumes.scale[cell] ** 2))
        extinction[inside] += density * coefficient
    return extinction.sum(axis=-1) * step


@pytest.mark.parametrize("shape", [box, egg, grid])
def test_optical_depth_is_that_of_cycles(shape, converted, tmp_path):
    empty_cycles_scene(samples=16)
    shape(tmp_path)
    bpy.context.object.data.materials.append(absorbing())
    expected, found = of_cycles(), of_cells(converted().volumes)
    assert expected.max() > 0.5
    assert found.sum() == pytest.approx(expected.sum(), rel=0.05)
    assert np.abs(found - expected).mean() < 0.1 * expected.mean()
