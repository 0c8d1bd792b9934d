# SPDX-License-Identifier: GPL-3.0-or-later
"""Only what has changed is read again, in slices that leave Blender's window alive."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.convert.copying import cache as copies
from bl_ext.user_default.renderformer_v2.rf2_engine.viewport import source as sources
from bl_ext.user_default.renderformer_v2.rf2_engine.viewport import viewport
from bl_ext.user_default.renderformer_v2.rf2_engine.viewport.source import Source, hides_in, source_key

from tests.rf2_engine.f12 import cube, material, sun
from tests.rf2_engine.viewport.views import depsgraph, read


@pytest.fixture
def reads(monkeypatch):
    """Names of the objects whose meshes were read."""
    names = []

    def read_mesh(mesh, name, *rest, real=copies.read_mesh):
        names.append(name)
        return real(mesh, name, *rest)
    monkeypatch.setattr(copies, "read_mesh", read_mesh)
    return names


@pytest.fixture
def kept(scene):
    """A source of two cubes that the handlers know, as those of viewports in a window."""
    for i, name in enumerate(("A", "B")):
        cube(scene, name, (3 * i, 0, 0), material(name))
    sun(scene)
    source = Source()
    viewport._sources[source_key(depsgraph())] = source
    return read(source)


def again(source):
    """After what Blender says of a change."""
    bpy.context.view_layer.update()
    changed = source.changes.anything
    version = read(source).version
    return changed, version


def test_nothing_is_read_without_a_change(kept, reads):
    assert again(kept) == (False, 1) and not reads


def test_a_moved_object_is_placed_anew_and_no_mesh_is_read(kept, reads):
    bpy.data.objects["A"].location.z = 2
    assert again(kept) == (True, 2) and not reads
    assert kept.copied.objects[0][1].matrix[2, 3] == 2


def test_an_edited_mesh_is_read_and_no_other(kept, reads):
    mesh = bpy.data.objects["A"].data
    mesh.vertices[0].co.x = -5
    mesh.update()
    assert again(kept) == (True, 2) and reads == ["A"]
    assert kept.copied.objects[0][0].mesh.corners.min() == -5


def test_a_modifier_counts_as_viewports_show_it(kept, reads):
    modifier = bpy.data.objects["B"].modifiers.new("Array", "ARRAY")
    modifier.relative_offset_displace[0] = 2
    assert again(kept) == (True, 2) and reads == ["B"]
    assert len(kept.copied.objects[1][0].mesh) == 24
    modifier.show_viewport = False
    again(kept)
    assert len(kept.copied.objects[1][0].mesh) == 12


def test_material_lamp_and_world_are_copied_without_meshes(kept, reads):
    bpy.data.materials["A"].node_tree.nodes["Principled BSDF"].inputs["Roughness"].default_value = 0.25
    assert again(kept)[0]
    bpy.data.lights["Sun"].energy = 7
    assert again(kept)[0] and kept.copied.lamps[0].light.energy == 7
    bpy.data.worlds["Grey"].node_tree.nodes["Background"].inputs["Strength"].default_value = 2
    assert again(kept) == (True, 4) and not reads


def test_cameras_are_no_change(kept):
    bpy.data.objects["Camera"].location.x = 3
    assert again(kept) == (False, 1)
    bpy.data.cameras["Camera"].lens = 20
    assert again(kept) == (False, 1)


def test_a_new_object_is_read_and_a_deleted_one_forgotten(kept, reads, scene):
    added = cube(scene, "C", (0, 3, 0))
    assert again(kept)[0] and reads == ["C"] and len(kept._cache) == 3
    bpy.data.objects.remove(added)
    assert again(kept)[0] and reads == ["C"] and len(kept._cache) == 2 and len(kept.copied.objects) == 2


def test_hidden_objects_and_animation_follow(kept, scene):
    bpy.data.objects["A"].hide_set(True)
    assert again(kept)[0] and len(kept.copied.objects) == 1
    bpy.data.objects["A"].hide_set(False)
    again(kept)
    moving = bpy.data.objects["A"]
    for frame, x in ((1, 0), (11, 10)):
        moving.location.x = x
        moving.keyframe_insert("location", frame=frame)
    again(kept)
    scene.frame_set(11)
    assert again(kept)[0] and kept.copied.objects[0][1].matrix[0, 3] == 10


def test_renders_hide_other_objects_than_viewports(kept):
    bpy.data.objects["A"].hide_render = True
    again(kept)
    assert len(kept.copied.objects) == 2


def test_after_undo_everything_is_read(kept, reads):
    viewport.note_undo()
    assert again(kept) == (True, 2) and reads == ["A", "B"]


def test_an_image_is_read_again_when_it_has_changed(kept, scene):
    image = bpy.data.images.new("Picture", 8, 8)
    tree = bpy.data.materials["A"].node_tree
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    tree.links.new(node.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    again(kept)
    (before,) = kept._cache.images.values()
    bpy.data.objects["B"].location.z = 1
    again(kept)
    assert next(iter(kept._cache.images.values())) is before
    image.colorspace_settings.name = "Non-Color"
    again(kept)
    assert next(iter(kept._cache.images.values())) is not before


def test_what_takes_long_is_read_in_slices(scene, reads, monkeypatch):
    monkeypatch.setattr(sources, "SLICE", 0.0)
    for i in range(3):
        cube(scene, f"Cube {i}", (3 * i, 0, 0))
    source, slices = Source(), 0
    while not source.refresh(depsgraph()):
        slices += 1
        assert len(reads) == slices
    assert slices == 3 and reads == ["Cube 0", "Cube 1", "Cube 2"] and len(source.copied.objects) == 3


def test_of_a_scene_that_takes_long_there_is_a_bare_copy_before_images_are_read(scene, monkeypatch):
    monkeypatch.setattr(sources, "SLICE", 0.0)
    for i in range(2):
        of = material(f"Textured {i}")
        of.node_tree.nodes.new("ShaderNodeTexImage").image = bpy.data.images.new(f"Image {i}", 4, 4)
        of.node_tree.links.new(of.node_tree.nodes["Image Texture"].outputs["Color"],
                               of.node_tree.nodes["Principled BSDF"].inputs["Base Color"])
        cube(scene, f"Cube {i}", (3 * i, 0, 0), of)
    source = Source()
    while source.bare is None:
        assert not source.refresh(depsgraph()) and not source.version
    assert source.newest is source.bare and len(source.bare.objects) == 2 and len(source._cache.images) < 2
    bare = source.bare
    read(source)
    assert source.newest is source.copied and source.bare is None
    assert [item[0].mesh for item in source.copied.objects] == [item[0].mesh for item in bare.objects]


def test_an_edit_between_two_slices_is_not_lost(scene, monkeypatch):
    monkeypatch.setattr(sources, "SLICE", 0.0)
    for i in range(3):
        cube(scene, f"Cube {i}", (3 * i, 0, 0))
    source = viewport._sources[source_key(depsgraph())] = Source()
    assert not source.refresh(depsgraph())
    mesh = bpy.data.objects["Cube 0"].data
    mesh.vertices[0].co.x = -5
    mesh.update()
    bpy.context.view_layer.update()
    read(source)
    assert source.copied.objects[0][0].mesh.corners.min() == -5


def test_a_viewport_that_hides_objects_of_its_own_has_its_own_copy():
    bpy.ops.wm.read_factory_settings()
    window = bpy.context.window_manager.windows[0]
    space = next(area.spaces.active for area in window.screen.areas if area.type == "VIEW_3D")
    shared = source_key(depsgraph(), space)
    assert shared == source_key(depsgraph())
    space.show_object_viewport_mesh = False
    assert source_key(depsgraph(), space) != shared
    bpy.context.view_layer.update()
    assert len(read(hides=hides_in(space)).copied.objects) == 0
    space.show_object_viewport_mesh = True
    assert len(read(hides=hides_in(space)).copied.objects) == 1


def test_copies_do_not_change_when_the_scene_does(kept):
    first, matrix = kept.copied, kept.copied.objects[0][1].matrix.copy()
    bpy.data.objects["A"].location.z = 2
    again(kept)
    assert kept.copied is not first
    np.testing.assert_array_equal(first.objects[0][1].matrix, matrix)


def test_meshes_that_geometry_nodes_instance_are_kept_until_these_change(kept, reads):
    group = bpy.data.node_groups.new("Cubes", "GeometryNodeTree")
    group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    line, cubes, instances, output = (group.nodes.new(name) for name in (
        "GeometryNodeMeshLine", "GeometryNodeMeshCube", "GeometryNodeInstanceOnPoints", "NodeGroupOutput"))
    group.links.new(line.outputs["Mesh"], instances.inputs["Points"])
    group.links.new(cubes.outputs["Mesh"], instances.inputs["Instance"])
    group.links.new(instances.outputs["Instances"], output.inputs[0])
    bpy.data.objects["A"].modifiers.new("Cubes", "NODES").node_group = group
    again(kept)
    count = len(reads)
    assert len(kept.copied.objects) == 1 + 10 + 1 and 0 < count < 10  # A itself is empty
    bpy.data.objects["B"].location.z = 1
    again(kept)
    assert len(reads) == count
    cubes.inputs["Size"].default_value = (3, 3, 3)
    again(kept)
    assert len(reads) > count and np.ptp(kept.copied.objects[1][0].mesh.corners) == 3


def test_a_scene_that_cannot_be_read_is_said_once_and_tried_again_after_a_change(kept, monkeypatch):
    from bl_ext.user_default.renderformer_v2.model.errors import SceneError

    def fails(*_, **__):
        raise SceneError("The floor is lava: cool it")
    with monkeypatch.context() as patch:
        patch.setattr(sources, "copy", fails)
        bpy.data.objects["A"].location.z = 1
        assert again(kept) == (True, 1) and kept.error == "The floor is lava: cool it"
        assert again(kept) == (False, 1)
    bpy.data.objects["A"].location.z = 2
    assert again(kept) == (True, 2) and not kept.error
