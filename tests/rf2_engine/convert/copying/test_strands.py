# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays meet all hair and points where Cycles sees them; their tokens are of about the same extent and colour."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.first_hits.camera_rays import cast_guides
from bl_ext.user_default.renderformer_v2.model.scene import BASE_COLOR
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.camera.camera import convert_camera
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.mesh import areas

from tests.rf2_engine.convert.cycles_reference import material
from tests.rf2_engine.f12 import press_f12

SIZE = 64


def hair(material):
    """600 upright strands of 2 m on a square of 2 m around (0, 0, -1)."""
    curves = bpy.data.hair_curves.new("Hair")
    curves.add_curves([3] * 600)
    place = np.random.default_rng(0).uniform(-1, 1, (600, 1, 3)).repeat(3, axis=1)
    place[:, :, 2] = (-1, 0, 1)
    curves.points.foreach_set("position", place.astype(np.float32).ravel())
    curves.points.foreach_set("radius", np.full(1800, 0.004, np.float32))
    return curves


def cloud(material):
    """600 balls in a cube of 2 m, by geometry nodes."""
    tree = bpy.data.node_groups.new("points", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    points, dress = tree.nodes.new("GeometryNodePoints"), tree.nodes.new("GeometryNodeSetMaterial")
    place = tree.nodes.new("FunctionNodeRandomValue")
    place.data_type = "FLOAT_VECTOR"
    place.inputs["Min"].default_value = (-1, -1, -1)
    points.inputs["Count"].default_value, points.inputs["Radius"].default_value = 600, 0.03
    dress.inputs["Material"].default_value = material
    tree.links.new(place.outputs[0], points.inputs["Position"])
    tree.links.new(points.outputs[0], dress.inputs["Geometry"])
    tree.links.new(dress.outputs[0], tree.nodes.new("NodeGroupOutput").inputs[0])
    return tree


def grown(material):
    bpy.ops.mesh.primitive_plane_add(size=2, location=(0, 0, -1))
    obj = bpy.context.object
    obj.data.materials.append(material)
    settings = obj.modifiers.new("hair", "PARTICLE_SYSTEM").particle_system.settings
    settings.type, settings.count, settings.hair_length = "HAIR", 600, 2
    settings.root_radius = settings.tip_radius = 0.8
    obj.show_instancer_for_render = False
    return obj


def add(kind, material):
    made = kind(material)
    if kind is grown:
        return made
    if isinstance(made, bpy.types.Curves):
        made.materials.append(material)
        obj = bpy.data.objects.new("Hair", made)
    else:
        obj = bpy.data.objects.new("Cloud", bpy.data.meshes.new("Cloud"))
        obj.modifiers.new("points", "NODES").node_group = made
    bpy.context.scene.collection.objects.link(obj)
    return obj


@pytest.mark.parametrize("kind", [hair, cloud, grown])
def test_rays_meet_what_cycles_sees(scene, converted, add_material, report, kind):
    obj = add(kind, add_material("green", (0.1, 0.7, 0.2)))
    obj.location.x += 0.3
    result = converted()
    assert 200 < len(result) <= 1100
    low, high = result.triangles.min(axis=(0, 1)), result.triangles.max(axis=(0, 1))
    np.testing.assert_allclose([low, high], [(-0.7, -1, -1), (1.3, 1, 1)], atol=0.25)
    np.testing.assert_allclose(result.tiles[result.tile_index][:, BASE_COLOR, 0, 0], np.tile((0.1, 0.7, 0.2),
                               (len(result), 1)), atol=1e-3)
    guides = cast_guides(result, convert_camera(bpy.context.evaluated_depsgraph_get(), SIZE, SIZE, None))
    assert guides.alpha.mean() == pytest.approx(seen_by_cycles(scene), rel=0.1)
    assert [kind for kind, name, _ in report.entries if name == obj.name] == ["approximated"]


def test_hair_is_met_where_its_emitter_is_hidden(scene, converted, add_material):
    obj = grown(add_material("green", (0.1, 0.7, 0.2)))
    both = converted()
    obj.show_instancer_for_viewport = False  # which the depsgraph outside of a render obeys
    hair_alone = converted()
    assert len(hair_alone) > 200
    assert 1 <= len(both) - len(hair_alone) <= 100  # those of the emitter
    assert np.ptp(hair_alone.triangles[..., 2], axis=1).min() > 0


def three_strands(material):
    """Upright strands of different lengths, whose attribute "tint" grows along them."""
    curves = bpy.data.hair_curves.new("Hair")
    curves.add_curves([4] * 3)
    place = np.zeros((3, 4, 3), np.float32)
    place[..., 0], place[..., 2] = [[-0.6], [0], [0.6]], np.float32([[0.4], [0.7], [1]]) * [-1, -0.5, 0.5, 1]
    curves.points.foreach_set("position", place.ravel())
    curves.points.foreach_set("radius", np.full(12, 0.1, np.float32))
    curves.attributes.new("tint", "FLOAT", "POINT").data.foreach_set("value", np.tile(np.float32([0, 0.2, 0.4, 1]), 3))
    return curves


def three_points(material):
    """Balls of different sizes in a row, by geometry nodes, with an attribute "tint"."""
    tree = cloud(material)
    points, dress = tree.nodes["Points"], tree.nodes["Set Material"]
    points.inputs["Count"].default_value = 3
    index, size, place, store = (tree.nodes.new(kind) for kind in (
        "GeometryNodeInputIndex", "ShaderNodeMath", "ShaderNodeCombineXYZ", "GeometryNodeStoreNamedAttribute"))
    size.operation, size.inputs[0].default_value, size.inputs[1].default_value = "MULTIPLY_ADD", 0.1, 0.1
    store.inputs["Name"].default_value = "tint"
    size.inputs[2].default_value = 0.1
    for source, target in ((index.outputs[0], size.inputs[0]), (index.outputs[0], place.inputs[0]),
                           (place.outputs[0], points.inputs["Position"]), (size.outputs[0], points.inputs["Radius"]),
                           (size.outputs[0], next(s for s in store.inputs if s.name == "Value" and s.enabled)),
                           (points.outputs[0], store.inputs["Geometry"]), (store.outputs[0], dress.inputs["Geometry"])):
        tree.links.new(source, target)
    return tree


@pytest.mark.parametrize("kind, node, output", [
    (three_strands, "ShaderNodeHairInfo", "Intercept"), (three_strands, "ShaderNodeHairInfo", "Length"),
    (three_strands, "ShaderNodeHairInfo", "Thickness"), (three_points, "ShaderNodePointInfo", "Radius"),
    (three_points, "ShaderNodePointInfo", "Position")])
def test_hair_and_points_have_attributes_and_numbers(scene, converted, tmp_path, kind, node, output):
    shining, tree, emission = material("ShaderNodeEmission")
    join, info, tint = (tree.nodes.new(k) for k in ("ShaderNodeCombineColor", node, "ShaderNodeAttribute"))
    tint.attribute_name = "tint"
    for i, source in enumerate((info.outputs[output], info.outputs["Random"], tint.outputs["Fac"])):
        tree.links.new(source, join.inputs[i])
    tree.links.new(join.outputs[0], emission.inputs["Color"])
    obj = add(kind, shining)
    obj.location, obj.scale = (0.2, 0, 0.1), (0.5, 0.5, 0.5)
    result = converted()
    shines = areas(result.triangles) @ result.emission / areas(result.triangles).sum()
    scene.render.engine, scene.cycles.samples, scene.render.film_transparent = "CYCLES", 16, True
    scene.render.resolution_x = scene.render.resolution_y = 4 * SIZE
    seen = press_f12(scene, tmp_path)["ViewLayer.Combined"].sum(axis=(0, 1))
    np.testing.assert_allclose(shines, seen[:3] / seen[3], rtol=0.06)


def seen_by_cycles(scene) -> float:
    """Mean coverage of the picture."""
    scene.render.engine, scene.cycles.samples, scene.render.film_transparent = "CYCLES", 4, True
    scene.cycles.max_bounces, scene.cycles.use_denoising = 0, False
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    scene.render.image_settings.file_format = "PNG"
    scene.render.filepath = bpy.app.tempdir + "seen.png"
    bpy.ops.render.render(write_still=True)
    return float(np.array(bpy.data.images.load(scene.render.filepath).pixels).reshape(-1, 4)[:, 3].mean())
