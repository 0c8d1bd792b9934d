# SPDX-License-Identifier: GPL-3.0-or-later
"""Nodes that only Cycles can evaluate are baked where the user allows it, and the scene stays as it is."""
import tempfile

import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model import progress
from bl_ext.user_default.renderformer_v2.model.errors import RenderCancelled
from bl_ext.user_default.renderformer_v2.model.scene import BASE_COLOR, NORMAL, ROUGHNESS
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.copied import ConversionOptions
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.report import Report
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.scene import convert
from bl_ext.user_default.renderformer_v2.rf2_engine.cycles import bake
from bl_ext.user_default.renderformer_v2.rf2_engine.frame import preflight
from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render

from tests.rf2_engine.f12 import press_f12

INSIDE = np.add.outer(np.arange(32), np.arange(32)) < 30


@pytest.fixture
def baked(monkeypatch, tmp_path):
    """Function that converts the scene with a Baker, whose files lie in tmp_path; returns it and the report."""
    def run():
        monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
        depsgraph, report = bpy.context.evaluated_depsgraph_get(), Report()
        with bake.Baker(depsgraph) as baker:
            return convert(depsgraph, None, ConversionOptions(1000, 1e6), report, baker=baker), report.lines()
    return run


def cube(scene, **links):
    """A cube of a Principled material "Rock" whose inputs are linked to new nodes: input=(kind, output, settings)."""
    bpy.ops.mesh.primitive_cube_add()
    made = bpy.data.materials.new("Rock")
    made.use_nodes = True
    bpy.context.object.data.materials.append(made)
    for name, (kind, output, inputs) in links.items():
        node = made.node_tree.nodes.new("ShaderNode" + kind)
        for key, value in inputs.items():
            node.inputs[key].default_value = value
        made.node_tree.links.new(node.outputs[output], principled(made).inputs[name.replace("_", " ")])
    return bpy.context.object


def principled(material):
    return material.node_tree.nodes["Principled BSDF"]


def contents():
    """How much there is of everything, and what is linked to what."""
    return {name: len(getattr(bpy.data, name)) for name in ("objects", "meshes", "materials", "images", "scenes")}, [
        (link.from_node.name, link.to_socket.name) for link in bpy.data.materials["Rock"].node_tree.links]


def test_what_only_cycles_knows_is_baked_on_the_triangles(scene, baked, tmp_path):
    """On a floor half of all ways out are barred from a wall. Wires lie along edges; a bevel turns normals there."""
    cube(scene, Base_Color=("AmbientOcclusion", "Color", {"Distance": 10.0}),
         Roughness=("Wireframe", "Fac", {"Size": 0.4}), Normal=("Bevel", "Normal", {"Radius": 0.6})).location.x = 0.5
    bpy.ops.mesh.primitive_plane_add(size=200, location=(0, 0, -1.001))
    before = contents()
    found, lines = baked()
    assert contents() == before and not list(tmp_path.iterdir())
    tiles = found.tiles[found.tile_index].astype(np.float32)
    normal = np.cross(*(found.triangles[:, 1:] - found.triangles[:, :1]).transpose(1, 0, 2))
    of_box = np.abs(found.triangles).max(axis=(1, 2)) < 5
    top, side = of_box & (normal[:, 2] > 1), of_box & (np.abs(normal[:, 2]) < 1)
    lit = tiles[:, BASE_COLOR][..., INSIDE].mean(axis=(1, 2))
    np.testing.assert_allclose(lit[top], 1, atol=0.01)
    np.testing.assert_allclose(lit[side], 0.5, atol=0.1)
    rough, bent = tiles[of_box, ROUGHNESS], tiles[of_box, NORMAL]
    assert rough[:, 0, :].mean() > 0.9 and rough[:, 10, 10].max() < 0.1
    assert bent[:, 2, 10, 10].min() > 0.99 and bent[:, 2, 0, 10].min() < 0.9
    assert all(any(name in line and 'baked it on "Cube"' in line for line in lines)
               for name in ("Ambient Occlusion", "Wireframe", "Bevel"))


def test_a_node_in_a_group_is_baked_on_an_instance_and_calculated_with(scene, baked):
    box = cube(scene)
    made = box.active_material
    group = bpy.data.node_groups.new("Inside", "ShaderNodeTree")
    group.interface.new_socket("Out", in_out="OUTPUT", socket_type="NodeSocketFloat")
    wire, half, end = (group.nodes.new(kind) for kind in ("ShaderNodeWireframe", "ShaderNodeMath", "NodeGroupOutput"))
    wire.inputs["Size"].default_value, half.operation, half.inputs[1].default_value = 0.4, "MULTIPLY", 0.5
    group.links.new(wire.outputs[0], half.inputs[0])
    group.links.new(half.outputs[0], end.inputs[0])
    user = made.node_tree.nodes.new("ShaderNodeGroup")
    user.node_tree = group
    made.node_tree.links.new(user.outputs[0], principled(made).inputs["Roughness"])
    hidden = bpy.data.collections.new("Boxes")
    scene.collection.objects.unlink(box)
    hidden.objects.link(box)
    empty = bpy.data.objects.new("Empty", None)
    empty.instance_type, empty.instance_collection, empty.location = "COLLECTION", hidden, (4, 0, 1)
    scene.collection.objects.link(empty)
    found, lines = baked()
    rough = found.tiles[found.tile_index, ROUGHNESS].astype(np.float32)
    np.testing.assert_allclose(rough[:, 0, 4:28], 0.5, atol=0.02)
    assert rough[:, 10, 10].max() < 0.1 and 'in "Inside"' in lines[0]


def test_the_material_override_of_a_view_layer_is_baked(scene, baked):
    cube(scene, Roughness=("Wireframe", "Fac", {"Size": 0.4}))
    scene.view_layers[0].material_override = bpy.context.object.active_material
    bpy.context.object.data.materials.clear()
    found, lines = baked()
    rough = found.tiles[found.tile_index, ROUGHNESS].astype(np.float32)
    np.testing.assert_allclose(rough[:, 0, 4:28], 1, atol=0.02)
    assert rough[:, 10, 10].max() < 0.1 and 'baked it on "Cube"' in lines[0]


def test_what_depends_on_the_view_is_not_baked(scene, baked):
    cube(scene, Roughness=("CameraData", "View Distance", {}), Metallic=("NewGeometry", "Incoming", {}))
    _, lines = baked()
    assert len(lines) == 2 and all("depends on the view" in line and "keeps its own value" in line for line in lines)
    assert not any("bake" in line.lower() for line in lines)


def test_f12_bakes_where_it_is_allowed(scene, tmp_path):
    cube(scene, Roughness=("Wireframe", "Fac", {}))
    scene.renderformer_v2.bake_unknown = True
    press_f12(scene, tmp_path)
    assert any("Wireframe" in line and "baked it on" in line for line in last_render.last_frame[0].report)


def test_preflight_bakes_nothing_and_says_so(scene):
    cube(scene, Roughness=("Wireframe", "Fac", {}))
    scene.renderformer_v2.bake_unknown = True
    found = preflight.run(bpy.context.evaluated_depsgraph_get(), lambda text, fraction: None)
    assert any("it is baked only when rendering" in str(remark) for remark in found.remarks)


def test_esc_ends_a_bake_and_leaves_nothing(scene, baked, tmp_path):
    cube(scene, Roughness=("Wireframe", "Fac", {}))
    before = contents()

    def listener(text, fraction):
        if text.startswith("Baking Wireframe of Rock"):
            raise RenderCancelled()

    with progress.reporting(listener), pytest.raises(RenderCancelled):
        baked()
    assert contents() == before and not list(tmp_path.iterdir())


def test_a_bake_that_fails_is_reported_and_the_input_keeps_its_value(scene, baked, monkeypatch, tmp_path):
    cube(scene, Roughness=("Wireframe", "Fac", {}))
    worker = tmp_path / "worker.py"
    worker.write_text("raise ImportError('no such thing')")
    monkeypatch.setattr(bake, "WORKER", worker)
    found, lines = baked()
    np.testing.assert_allclose(found.tiles[found.tile_index, ROUGHNESS], 0.5)
    assert "could not be baked" in lines[0] and "no such thing" in lines[0] and "keeps its own value" in lines[0]


def test_a_render_goes_on_when_the_baking_blender_dies(scene, tmp_path, monkeypatch):
    """It no longer reads when it is asked to bake."""
    cube(scene, Roughness=("Wireframe", "Fac", {}), Metallic=("AmbientOcclusion", "AO", {}))
    scene.renderformer_v2.bake_unknown = True
    worker = tmp_path / "worker.py"
    worker.write_text("import os, time\nos.close(0)\nprint('ready', flush=True)\ntime.sleep(60)")
    monkeypatch.setattr(bake, "WORKER", worker)
    press_f12(scene, tmp_path)
    (last,) = last_render.last_frame
    assert last.device and not last.error
    for node in ("Wireframe", "Ambient Occlusion"):
        assert any(node in line and "could not be baked" in line for line in last.report)
