# SPDX-License-Identifier: GPL-3.0-or-later
"""Participating media as cells (docs/scene-input.md 5 and 13)."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model import progress
from bl_ext.user_default.renderformer_v2.model.errors import RenderCancelled
from bl_ext.user_default.renderformer_v2.rf2_engine import compat
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.copying import vdb


@pytest.fixture
def absorbing(scene):
    """A material with nothing but a Volume Coefficients shader: scattering (1, 2, 3), absorption (4, 5, 6)."""
    material = bpy.data.materials.new("smoke")
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.remove(tree.nodes["Principled BSDF"])
    shader = tree.nodes.new("ShaderNodeVolumeCoefficients")
    shader.inputs["Scatter Coefficients"].default_value = (1, 2, 3)
    shader.inputs["Absorption Coefficients"].default_value = (4, 5, 6)
    tree.links.new(shader.outputs[0], tree.nodes["Material Output"].inputs["Volume"])
    return material


@pytest.fixture
def dense(absorbing):
    """A copy of it, times the grid of densities: without one Cycles shows nothing of a Volume object."""
    material = absorbing.copy()
    material.name = "dense"
    tree = material.node_tree
    shader, info = tree.nodes["Volume Coefficients"], tree.nodes.new("ShaderNodeVolumeInfo")
    for name in ("Scatter Coefficients", "Absorption Coefficients"):
        times = tree.nodes.new("ShaderNodeVectorMath")
        times.operation, times.inputs[0].default_value = "SCALE", shader.inputs[name].default_value
        tree.links.new(info.outputs["Density"], times.inputs["Scale"])
        tree.links.new(times.outputs[0], shader.inputs[name])
    return material


@pytest.fixture
def add_grid(scene, tmp_path, dense):
    """Function that links a Volume object with a density grid whose index centre is at the object's origin."""
    def add(values, voxel):
        openvdb = vdb.openvdb_module()
        grid = openvdb.FloatGrid(0.0)
        grid.copyFromArray(np.asarray(values, np.float32))
        grid.name = "density"
        offset = -(np.array(values.shape) - 1) / 2 * voxel
        grid.transform = openvdb.createLinearTransform(
            [[voxel, 0, 0, 0], [0, voxel, 0, 0], [0, 0, voxel, 0], [*offset, 1]])
        openvdb.write(str(tmp_path / "grid.vdb"), [grid])
        volume = bpy.data.volumes.new("smoke")
        volume.filepath = str(tmp_path / "grid.vdb")
        volume.materials.append(dense)
        obj = bpy.data.objects.new("smoke", volume)
        scene.collection.objects.link(obj)
        return obj
    return add


def test_canonical_grid_gives_the_cells_of_the_specification(add_grid, converted):
    values = np.zeros((32, 32, 32))
    values[:] = np.arange(32)[:, None, None] / 124 + 0.75  # grows along x
    add_grid(values, 1 / 32)
    volumes = converted().volumes
    assert len(volumes) == 512
    shift = compat.first_voxel_begins() / 32
    np.testing.assert_allclose(volumes.position.min(axis=0), -0.421875 + shift, atol=1e-5)
    np.testing.assert_allclose(volumes.position.max(axis=0), 0.453125 + shift, atol=1e-5)
    np.testing.assert_allclose(volumes.scale, 1, atol=1e-5)
    first = volumes.position.sum(axis=1).argmin()
    np.testing.assert_allclose(volumes.density[first], np.tile(values[:4, 0, 0] / values.max(), 16), atol=1e-5)
    np.testing.assert_allclose(volumes.scattering[0], [1, 2, 3], rtol=1e-5)
    np.testing.assert_allclose(volumes.absorption[0], [4, 5, 6], rtol=1e-5)


def test_half_of_a_large_grid_is_occupied_under_a_rotated_scaled_object(add_grid, converted):
    values = np.full((96, 64, 64), 1e-3)
    values[48:] = 2
    obj = add_grid(values, 1 / 64)
    obj.location, obj.rotation_euler, obj.scale = (1, 2, 3), (0.3, -0.4, 0.5), (2, 2, 2)
    volumes = converted().volumes
    assert len(volumes) == 256
    local = (volumes.position - np.float32((1, 2, 3))) @ np.array(obj.rotation_euler.to_matrix())
    assert local[:, 0].min() > 0.1 and local[:, 0].max() < 1.5
    np.testing.assert_allclose(volumes.scale[0], [3, 2, 2], rtol=1e-5)
    np.testing.assert_allclose(volumes.rotation[0], [0.3, -0.4, 0.5], atol=1e-5)
    # Optical depth of a volume object does not change with its scale: coefficient 1 per unit at density 1 and scale 1.
    box = np.sqrt(np.mean(np.square([3, 2, 2])))
    np.testing.assert_allclose(volumes.scattering[0], np.array([1, 2, 3]) * 2 * box / 2, rtol=1e-4)


def test_mesh_with_volume_shader_is_filled_and_has_no_surface(converted, absorbing):
    bpy.ops.mesh.primitive_uv_sphere_add(radius=1.5, segments=64, ring_count=32, location=(1, 0, 0))
    bpy.context.object.data.materials.append(absorbing)
    bpy.context.object.scale = (1, 1, 2)
    scene = converted()
    assert len(scene) == 0
    volumes = scene.volumes
    np.testing.assert_allclose(volumes.scale[0], [3, 3, 6], rtol=1e-2)
    filled = volumes.density.sum() * np.prod(volumes.scale[0]) / 32 ** 3
    assert filled == pytest.approx(4 / 3 * np.pi * 1.5 ** 2 * 1.5 * 2, rel=0.03)
    np.testing.assert_allclose(volumes.position.mean(axis=0), (1, 0, 0), atol=0.05)
    np.testing.assert_allclose(volumes.absorption[0] / np.sqrt(np.mean(volumes.scale[0] ** 2)), [4, 5, 6], rtol=1e-4)


def test_what_is_scaled_to_nothing_is_no_medium(converted, add_grid, absorbing):
    bpy.ops.mesh.primitive_cube_add(scale=(1, 0, 1))
    bpy.context.object.data.materials.append(absorbing)
    add_grid(np.ones((8, 8, 8)), 0.1).scale = (1, 1, 0)
    assert converted().volumes is None


def test_many_volumes_share_the_cells_and_it_is_reported(converted, absorbing, report):
    for i in range(4):
        bpy.ops.mesh.primitive_cube_add(location=(4 * i, 0, 0), scale=(1, 1, 1 + 0.1 * i))
        bpy.context.object.data.materials.append(absorbing)
    volumes = converted().volumes
    assert len(volumes) <= 1024
    assert set(np.round(volumes.position[:, 0] / 4)) == {0, 1, 2, 3}
    cells = np.prod(volumes.scale / 8, axis=1)
    assert cells.sum() == pytest.approx(8 * (1 + 1.1 + 1.2 + 1.3), rel=1e-3)
    assert any("cells per axis" in message for _, _, message in report.entries)


def test_instances_of_a_textured_medium_are_alike_however_they_stand(converted, absorbing):
    tree = absorbing.node_tree
    noise = tree.nodes.new("ShaderNodeTexNoise")
    tree.links.new(noise.outputs[0], tree.nodes["Volume Coefficients"].inputs["Absorption Coefficients"])
    bpy.ops.mesh.primitive_cone_add()
    first = bpy.context.object
    first.data.materials.append(absorbing)
    alone = converted().volumes
    for i, (turn, scale) in enumerate((((0.3, 1.2, -2), (1, 1, 1)), ((0, 0, 1), (2, 0.5, 1)), ((0, 0, 0), (-1, 1, 1)))):
        other = bpy.data.objects.new("Other", first.data)
        bpy.context.scene.collection.objects.link(other)
        other.location, other.rotation_euler, other.scale = (5 * i + 5, 0, 0), turn, scale
        first.hide_render = first.hide_viewport = True
        volumes = converted().volumes
        assert len(volumes) == len(alone)
        if min(scale) > 0:
            np.testing.assert_allclose(volumes.density, alone.density, atol=1e-3)
        else:  # its box is turned round, and so are its cells
            assert volumes.density.sum() == pytest.approx(alone.density.sum(), rel=1e-3)
            assert np.abs(volumes.density - alone.density).max() > 0.05
        bpy.data.objects.remove(other)
        first.hide_render = first.hide_viewport = False


def test_an_instance_that_its_shader_tells_apart_is_its_own(converted, absorbing):
    tree = absorbing.node_tree
    info = tree.nodes.new("ShaderNodeObjectInfo")
    tree.links.new(info.outputs["Color"], tree.nodes["Volume Coefficients"].inputs["Scatter Coefficients"])
    bpy.ops.mesh.primitive_cube_add()
    bpy.context.object.data.materials.append(absorbing)
    other = bpy.data.objects.new("Other", bpy.context.object.data)
    bpy.context.scene.collection.objects.link(other)
    other.location.x, other.color, bpy.context.object.color = 5, (1, 0.5, 0.25, 1), (0.1, 0.2, 0.3, 1)
    volumes = converted().volumes
    for obj in (bpy.context.object, other):
        own = np.abs(volumes.position[:, 0] - obj.location.x) < 2
        np.testing.assert_allclose(volumes.scattering[own], [np.float32(obj.color[:3]) * 2] * own.sum(), rtol=1e-4)


def test_use_volumes_of_the_view_layer_hides_volume_objects_alone(add_grid, converted, absorbing):
    add_grid(np.ones((8, 8, 8)), 1 / 8)
    bpy.context.view_layer.use_volumes = False
    assert converted().volumes is None
    bpy.ops.mesh.primitive_cube_add()
    bpy.context.object.data.materials.append(absorbing)
    assert len(converted().volumes) == 512  # as Cycles does


def test_gas_domains_are_left_out_by_name(converted, absorbing, report, tmp_path):
    bpy.ops.mesh.primitive_cube_add()
    domain = bpy.context.object
    domain.data.materials.append(absorbing)
    modifier = domain.modifiers.new("Fluid", "FLUID")
    modifier.show_viewport = False  # nothing is simulated here
    modifier.fluid_type = "DOMAIN"
    modifier.domain_settings.cache_directory = str(tmp_path)
    assert modifier.domain_settings.domain_type == "GAS"
    scene = converted()
    assert scene.volumes is None and len(scene) == 0
    assert ("skipped", domain.name) in [entry[:2] for entry in report.entries]
    modifier.domain_settings.domain_type = "LIQUID"
    assert converted().volumes is not None


def test_converting_volumes_shows_progress_and_can_be_cancelled(converted, absorbing):
    for i in range(30):
        bpy.ops.mesh.primitive_cube_add(location=(4 * i, 0, 0))
        bpy.context.object.data.materials.append(absorbing)
    fractions = []

    def listen(text, fraction):
        if text == "Converting volumes":
            fractions.append(fraction)
            if len(fractions) == 40:
                raise RenderCancelled

    with pytest.raises(RenderCancelled), progress.reporting(listen):
        converted()
    assert fractions == sorted(fractions) and len(set(fractions)) > 15
