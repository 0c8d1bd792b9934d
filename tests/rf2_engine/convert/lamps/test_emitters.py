# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces that shine, as bright as in Cycles: light paths, visibility, view layers, light linking."""
import bpy
import numpy as np
import pytest

from mathutils import Matrix

from tests.rf2_engine.convert.cycles_reference import empty_cycles_scene, irradiance, lamp, material, world
from tests.rf2_engine.convert.token_light import integrated

FACING_DOWN = ((-0.5, -0.5, 2), (-0.5, 0.5, 2), (0.5, 0.5, 2), (0.5, -0.5, 2))
POINT, UP = (0.2, 0, 0), (0, 0, 1)


@pytest.fixture
def emitter(add_mesh):
    """A square of radiance 5 two metres above the origin; returns (object, node tree, Emission node)."""
    empty_cycles_scene()
    made, tree, node = material("ShaderNodeEmission", "Glow", Strength=5.0)
    return add_mesh("Square", FACING_DOWN, [(0, 1, 2, 3)], [made]), tree, node


def assert_as_bright_as_in_cycles(converted, rtol=0.03):
    expected = irradiance(POINT, UP)
    np.testing.assert_allclose(integrated(converted(), POINT, UP), expected, rtol=rtol, atol=1e-4)
    return expected


@pytest.mark.parametrize("hidden_from_camera", [True, False])
def test_emitters_that_light_paths_hide_light_as_in_cycles(emitter, converted, hidden_from_camera):
    _, tree, glow = emitter
    path, mix, clear = (tree.nodes.new("ShaderNode" + kind) for kind in ("LightPath", "MixShader", "BsdfTransparent"))
    shaders = (glow, clear) if hidden_from_camera else (clear, glow)
    tree.links.new(path.outputs["Is Camera Ray"], mix.inputs[0])
    for shader, entry in zip(shaders, (1, 2), strict=True):
        tree.links.new(shader.outputs[0], mix.inputs[entry])
    tree.links.new(mix.outputs[0], tree.get_output_node("CYCLES").inputs["Surface"])
    assert assert_as_bright_as_in_cycles(converted).any() == hidden_from_camera


def test_material_override_of_the_view_layer_takes_the_light_away(emitter, converted):
    assert assert_as_bright_as_in_cycles(converted).all()
    bpy.context.view_layer.material_override = material("ShaderNodeBsdfDiffuse", "Clay", Color=(0.1, 0.2, 0.3, 1))[0]
    scene = converted()
    assert not scene.emission.any()
    np.testing.assert_allclose(scene.tiles[scene.tile_index[0], :3, 0, 0], (0.1, 0.2, 0.3), atol=1e-3)


@pytest.mark.parametrize("switch", ["use_solid", "use_sky"])
def test_switches_of_the_view_layer_take_the_light_away(emitter, converted, switch):
    if switch == "use_sky":
        bpy.data.objects.remove(emitter[0])
        world()
    found = converted()
    assert len(found) or found.environment is not None
    setattr(bpy.context.view_layer, switch, False)
    assert not irradiance(POINT, UP).any() or switch == "use_solid"  # which hides the plane that measures, too
    found = converted()
    assert len(found) == 0 and found.environment is None


@pytest.mark.parametrize("hidden", [(), ("camera", "diffuse", "glossy", "transmission", "volume_scatter", "shadow")])
def test_ray_visibility_of_an_instancer_counts(emitter, converted, hidden):
    collection, host = bpy.data.collections.new("Parts"), bpy.data.objects.new("Host", None)
    collection.objects.link(emitter[0])
    bpy.context.scene.collection.objects.unlink(emitter[0])
    host.instance_type, host.instance_collection = "COLLECTION", collection
    bpy.context.scene.collection.objects.link(host)
    for ray in hidden:
        setattr(host, f"visible_{ray}", False)
    assert assert_as_bright_as_in_cycles(converted).any() != bool(hidden)


@pytest.mark.parametrize("kind", ["lamp", "surface"])
@pytest.mark.parametrize("state, receiver", [("INCLUDE", "absent"), ("INCLUDE", "there"), ("EXCLUDE", "there"),
                                             ("EXCLUDE", "absent"), (None, None)])
def test_emitters_light_the_groups_of_surfaces_that_they_are_linked_to(emitter, add_mesh, converted, kind, state,
                                                                       receiver):
    source = emitter[0]
    if kind == "lamp":
        source = lamp("POINT", Matrix.Translation((0, 0, 2)), energy=100, shadow_soft_size=0.1)
        bpy.data.objects.remove(emitter[0])
    add_mesh("Floor", np.multiply(FACING_DOWN, (9, 9, 0)), [(0, 1, 2, 3)])
    linked = add_mesh("Linked", np.add(FACING_DOWN, (9, 0, 0)), [(0, 1, 2, 3)])
    source.light_linking.receiver_collection = collection = bpy.data.collections.new("Receivers")
    if state:
        collection.objects.link(linked)
        collection.collection_objects[0].light_linking.link_state = state
        linked.hide_render = linked.hide_viewport = receiver == "absent"
    dark = irradiance((0, 0, 0.01), UP).max() < 1e-3
    assert dark == (state == "INCLUDE")
    scene = converted()
    shines = scene.emission.any()
    assert shines == ((state, receiver) != ("INCLUDE", "absent"))
    if receiver == "there":
        floor = scene.triangles[:, 0, 2] == 0
        linked, floor = (scene.group[there][0] for there in (scene.triangles[:, 0, 0] > 8, floor))
        lit = [(scene.lit_groups[scene.is_light] >> np.uint64(group) & np.uint64(1)).all() for group in (linked, floor)]
        assert lit == [state == "INCLUDE", state == "EXCLUDE"]
    else:
        assert scene.group is None


@pytest.mark.parametrize("cut", [False, True])
def test_holdout_collections_light_as_in_cycles(emitter, converted, report, cut):
    inside = bpy.data.collections.new("Cut Out")
    bpy.context.scene.collection.children.link(inside)
    bpy.context.scene.collection.objects.unlink(emitter[0])
    inside.objects.link(emitter[0])
    bpy.context.view_layer.layer_collection.children["Cut Out"].holdout = cut
    assert assert_as_bright_as_in_cycles(converted).all() and not report.entries
