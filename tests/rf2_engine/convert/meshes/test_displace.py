# SPDX-License-Identifier: GPL-3.0-or-later
"""Displacement: heights in the tiles, moved corners where that is too little, bent normals where it is a bump."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.scene import HEIGHT, NORMAL
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.report import Report
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.shading.material_tiles import MaterialTiles

from tests.rf2_engine.convert.copies import copied
from tests.rf2_engine.convert.cycles_reference import material, pictured
from tests.rf2_engine.convert.triangles import triangles

HILLS = np.pi  # per unit


def hills(method, height, space="OBJECT", shader="ShaderNodeEmission"):
    """A material that rises and falls along X by `height`, and shows how high it is."""
    made, tree, node = material(shader, "Hills")
    made.displacement_method = method
    sine, at, moved = (tree.nodes.new("ShaderNode" + kind) for kind in ("Math", "TexCoord", "Displacement"))
    waves, x, z, where = (tree.nodes.new("ShaderNode" + kind) for kind in (
        "Math", "SeparateXYZ", "SeparateXYZ", "NewGeometry"))
    waves.operation, waves.inputs[1].default_value, sine.operation = "MULTIPLY", HILLS, "SINE"
    moved.space, moved.inputs["Midlevel"].default_value, moved.inputs["Scale"].default_value = space, 0, height
    output = next(n for n in tree.nodes if n.type == "OUTPUT_MATERIAL")
    for source, entry in ((at.outputs["UV"], x.inputs[0]), (x.outputs["X"], waves.inputs[0]),
                          (waves.outputs[0], sine.inputs[0]), (sine.outputs[0], moved.inputs["Height"]),
                          (moved.outputs[0], output.inputs["Displacement"]), (where.outputs["Position"], z.inputs[0])):
        tree.links.new(source, entry)
    if shader == "ShaderNodeEmission":
        tree.links.new(z.outputs["Z"], node.inputs["Color"])
    return made


def field(cuts, made):
    """A square from -1 to 1 of so many pieces, its UVs from -1 to 1, lifted by 1."""
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=cuts, y_subdivisions=cuts, location=(0, 0, 1))
    obj = bpy.context.object
    layer = obj.data.uv_layers[0].uv
    uv = np.empty(2 * len(layer), np.float32)
    layer.foreach_get("vector", uv)
    layer.foreach_set("vector", 2 * uv - 1)
    obj.data.materials.append(made)
    return obj


def heights(scene, found):
    """Of the tokens' centres, and of Cycles' surface there."""
    scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", 1, False
    scene.cycles.dicing_rate = 1
    scene.render.image_settings.file_format = "OPEN_EXR"
    picture = pictured(2, 5, resolution=64)[..., 0]
    middle = found.triangles.mean(axis=1)
    pixel = np.clip((middle[:, :2] + 1) * 32, 0, 63).astype(int)
    return middle[:, 2], picture[pixel[:, 1], pixel[:, 0]]


@pytest.mark.parametrize("space, scale", [("OBJECT", (1, 1, 1)), ("OBJECT", (1, 1, 2)), ("WORLD", (1, 1, 2))])
def test_what_is_too_much_for_heights_moves_the_corners_as_in_cycles(scene, converted, report, space, scale):
    field(24, hills("DISPLACEMENT", 0.2, space)).scale = scale
    found = converted()
    ours, cycles = heights(scene, found)
    assert np.ptp(cycles) > 0.3 and np.abs(ours - cycles).mean() < 0.02
    assert not found.tiles[found.tile_index, HEIGHT].any()
    assert any("moves only the corners" in line for line in report.lines())


def test_a_mesh_that_cycles_dices_is_diced_and_displaced(scene, converted):
    obj = field(1, hills("DISPLACEMENT", 0.2))
    modifier = obj.modifiers.new("Subdivision", "SUBSURF")
    modifier.subdivision_type, modifier.levels, modifier.render_levels = "SIMPLE", 1, 1
    if hasattr(modifier, "use_adaptive_subdivision"):
        modifier.use_adaptive_subdivision = True
    else:
        scene.cycles.feature_set, obj.cycles.use_adaptive_subdivision = "EXPERIMENTAL", True
    found = converted(token_budget=2000)
    ours, cycles = heights(scene, found)
    assert len(found) > 1000 and np.ptp(cycles) > 0.3 and np.abs(ours - cycles).mean() < 0.02
    normal = found.normals[np.abs(found.triangles[:, 0, 0]) < 0.05].mean(axis=(0, 1))
    np.testing.assert_allclose(normal[0] / normal[2], -0.2 * HILLS, rtol=0.1)


def test_a_little_displacement_is_height(scene, converted):
    field(2, hills("BOTH", 0.02, shader="ShaderNodeBsdfDiffuse"))
    found = converted()
    assert np.ptp(found.triangles[..., 2]) < 1e-5 and found.tiles[found.tile_index, HEIGHT].max() > 0.5


@pytest.mark.parametrize("report", [Report()])
def test_bump_only_is_a_tile_of_normals(scene, report):
    made = hills("BUMP", 0.2, shader="ShaderNodeBsdfDiffuse")
    tiles = MaterialTiles(report)
    index, _ = tiles.triangle_tiles(copied(made), triangles(1, np.float32([[(1, -1), (-1, 1), (-1, -1)]])))
    tile = tiles.tiles[index[0]].astype(np.float32)
    np.testing.assert_allclose(tile[NORMAL][0, 8, 16] / tile[NORMAL][2, 8, 16], -0.2 * HILLS, rtol=0.05)
    assert not tile[HEIGHT].any() and not report.entries


def test_vector_displacement_is_reported(scene):
    made = hills("DISPLACEMENT", 0.2)
    output = next(n for n in made.node_tree.nodes if n.type == "OUTPUT_MATERIAL")
    made.node_tree.links.new(made.node_tree.nodes.new("ShaderNodeVectorDisplacement").outputs[0],
                             output.inputs["Displacement"])
    report = Report()
    MaterialTiles(report).triangle_tiles(copied(made), triangles(1))
    assert any('node "Vector Displacement": its displacement is ignored' in line for line in report.lines())
