# SPDX-License-Identifier: GPL-3.0-or-later
"""The network's box: what the camera looks at fills it, whatever else the scene holds."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.convert.camera.camera import convert_camera
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.collect import collect
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.copying.scene import copy
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.fitting.framing import find_box
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.fitting.visible import find_visible
from mathutils import Vector

EYE = (7.36, -6.93, 4.96)  # of Blender's default camera, which looks at a cube of 2 m


@pytest.fixture
def box(scene, report):
    """Function that gives the box of the default view after a cube was added."""
    bpy.ops.object.camera_add(location=EYE, rotation=np.radians((63.6, 0, 46.7)))
    scene.camera = bpy.context.object
    scene.camera.data.clip_end = 1e6
    bpy.ops.mesh.primitive_cube_add(size=2)

    def find():
        depsgraph = bpy.context.evaluated_depsgraph_get()
        found, view = collect(copy(depsgraph, report), report), convert_camera(depsgraph, 192, 108, None)
        return find_box(found, view, find_visible(found, view))
    return find


def side(box: np.ndarray) -> float:
    return float((box[1] - box[0]).max())


def assert_is_around_the_cube(box: np.ndarray):
    assert (box[0] < 0.5).all() and (box[1] > -0.5).all(), "the cube is in the box"
    assert 2 < side(box) < 15


def plane(size: float, z: float = -1.0):
    bpy.ops.mesh.primitive_plane_add(size=size, location=(0, 0, z))
    return bpy.context.object


def dome(radius: float):
    bpy.ops.mesh.primitive_uv_sphere_add(radius=radius)
    return bpy.context.object


SURROUNDINGS = {
    "ground of 20 m": lambda: plane(20),
    "ground of 1 km": lambda: plane(1000),
    "ground of 10 km": lambda: plane(10_000),
    "sky dome": lambda: dome(500),
    "ground and sky dome": lambda: (plane(1000), dome(800)),
    "far object": lambda: bpy.ops.mesh.primitive_cube_add(size=50, location=(-900, 900, 0)),
    "far object behind the camera": lambda: bpy.ops.mesh.primitive_cube_add(size=50, location=(900, -900, 0)),
}


def test_a_cube_alone_fills_the_box(box):
    np.testing.assert_allclose(box(), [(-1, -1, -1), (1, 1, 1)], atol=1e-5)


@pytest.mark.parametrize("surroundings", SURROUNDINGS)
def test_surroundings_do_not_shrink_what_is_looked_at(box, surroundings):
    SURROUNDINGS[surroundings]()
    assert_is_around_the_cube(box())


def test_a_small_object_in_a_shining_dome_is_looked_at(box, add_material):
    bpy.data.objects["Cube"].scale = (0.4, 0.4, 0.4)
    dome(500).data.materials.append(add_material("sky", emission=1.0))
    assert side(box()) < 5


def test_subdivision_does_not_change_the_box(box):
    ground = plane(50)
    before = box()
    modifier = ground.modifiers.new("fine", "SUBSURF")
    modifier.subdivision_type, modifier.levels, modifier.render_levels = "SIMPLE", 6, 6
    np.testing.assert_allclose(box(), before, atol=0.05 * side(before))


def test_a_room_around_the_camera_is_the_box_and_not_the_house(box):
    for x in range(-6, 7):
        bpy.ops.mesh.primitive_cube_add(size=10, location=(10 * x, 40, 0))
    dome(8.0)
    assert side(box()) <= 16.1


def test_a_view_of_nothing_takes_all_there_is(box, scene):
    scene.camera.rotation_euler = (np.pi, 0, 0)
    np.testing.assert_allclose(box(), [(-1, -1, -1), (1, 1, 1)], atol=1e-5)


def card(scene, distance: float):
    """A square that fills the picture, so far in front of the camera."""
    bpy.context.view_layer.update()
    bpy.ops.mesh.primitive_plane_add(size=2 * distance + 0.1, rotation=scene.camera.rotation_euler,
                                     location=scene.camera.matrix_world @ Vector((0, 0, -distance)))
    return bpy.context.object


@pytest.mark.parametrize("distance", [0.0, 0.05])
def test_what_the_camera_clips_is_looked_through(box, scene, distance):
    card(scene, distance)
    assert_is_around_the_cube(box())


def test_a_surface_through_a_camera_that_clips_nothing_leaves_a_box(box, scene):
    ground = plane(10, z=EYE[2])
    ground.location, scene.camera.data.clip_start = EYE, 1e-6
    scene.camera.rotation_euler = (np.pi / 2, 0, 0)
    assert np.isfinite(box()).all()


def test_what_is_hidden_from_the_camera_is_looked_through(box, scene):
    card(scene, 0.3).visible_camera = False
    assert_is_around_the_cube(box())


def clear(**inputs):
    material = bpy.data.materials.new("Clear")
    material.use_nodes = True
    for name, value in inputs.items():
        material.node_tree.nodes["Principled BSDF"].inputs[name.replace("_", " ")].default_value = value
    return material


@pytest.mark.parametrize("inputs", [{"Transmission_Weight": 1, "Roughness": 0}, {"Alpha": 0.2}])
def test_panes_close_before_the_camera_are_looked_through(box, scene, inputs):
    for distance in (0.3, 0.4):
        pane = card(scene, distance)
        pane.data.materials.append(clear(**inputs))
        pane.modifiers.new("thick", "SOLIDIFY").thickness = 0.01
    assert_is_around_the_cube(box())


@pytest.mark.parametrize("inputs", [{}, {"Transmission_Weight": 1, "Roughness": 0.8}, {"Alpha": 0.9}])
def test_a_card_that_hides_what_is_behind_it_is_looked_at(box, scene, inputs):
    card(scene, 0.3).data.materials.append(clear(**inputs))
    assert side(box()) < 1.1


def test_a_glass_vessel_is_looked_at_whatever_is_behind_it(box, scene):
    bpy.data.objects["Cube"].hide_render = bpy.data.objects["Cube"].hide_viewport = True
    bpy.ops.mesh.primitive_uv_sphere_add(radius=3)
    bpy.context.object.data.materials.append(clear(Transmission_Weight=1, Roughness=0))
    card(scene, 100.0)
    low, high = box()
    assert (low < -1).all() and (high > 1).all() and side([low, high]) < 30


def test_fog_around_the_camera_is_looked_through(box, scene):
    bpy.data.objects["Cube"].scale = (0.3, 0.3, 0.3)
    bpy.ops.mesh.primitive_cube_add(size=1000)
    bpy.context.object.data.materials.append(fog())
    assert_is_around_the_cube(box())


def test_fog_close_before_the_camera_is_looked_through(box, scene):
    """Its box begins a little in front of it and holds what is looked at."""
    bpy.data.objects["Cube"].scale = (0.3, 0.3, 0.3)
    bpy.ops.mesh.primitive_cube_add(size=1)
    around = bpy.context.object
    around.data.materials.append(fog())
    around.parent = scene.camera
    around.scale, around.location = (500, 500, 500), (0, 0, -250.3)
    assert_is_around_the_cube(box())


def test_smoke_before_a_wall_is_looked_at(box, scene):
    """As long as the wall is not far away."""
    bpy.data.objects["Cube"].data.materials.append(fog())
    card(scene, 12.0)
    assert side(box()) < 20


def fog():
    material = bpy.data.materials.new("Fog")
    material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.remove(nodes["Principled BSDF"])
    shader = nodes.new("ShaderNodeVolumePrincipled")
    material.node_tree.links.new(shader.outputs["Volume"], nodes["Material Output"].inputs["Volume"])
    return material
