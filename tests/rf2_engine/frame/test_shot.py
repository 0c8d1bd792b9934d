# SPDX-License-Identifier: GPL-3.0-or-later
"""The network's box over the frames of a render job."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.convert.camera.framing import Framing
from bl_ext.user_default.renderformer_v2.rf2_engine.frame import shot

from tests.rf2_engine.f12 import cube, mesh_object, sun

BOX = np.float32([(-1, -1, 0), (1, 1, 2)])


@pytest.fixture
def settled(scene):
    shot._kept.clear()
    yield lambda box: shot.steady(bpy.context.evaluated_depsgraph_get())(Framing(np.float32(box), None)).box
    shot._kept.clear()


def test_a_shot_keeps_the_box_of_its_first_frame(settled):
    np.testing.assert_array_equal(settled(BOX), BOX)
    np.testing.assert_array_equal(settled(1.5 * BOX), BOX)
    np.testing.assert_array_equal(settled(BOX + np.float32((1, 0, 0.5))), BOX)


@pytest.mark.parametrize("other", [BOX * 3, BOX / 3, BOX + np.float32((5, 0, 0))])
def test_a_camera_that_has_left_gets_a_new_box(settled, other):
    settled(BOX)
    np.testing.assert_array_equal(settled(other), other)


def test_every_camera_has_its_own(settled, scene):
    settled(BOX)
    bpy.ops.object.camera_add()
    scene.camera = bpy.context.object
    np.testing.assert_array_equal(settled(1.5 * BOX), np.float32(1.5 * BOX))


def test_the_next_render_job_looks_anew(settled, scene):
    settled(BOX)
    for handler in bpy.app.handlers.render_init:
        if handler.__module__ == shot.__name__:
            handler(scene)
    np.testing.assert_array_equal(settled(1.5 * BOX), np.float32(1.5 * BOX))


def test_every_view_layer_has_its_own(settled, scene):
    settled(BOX)
    with bpy.context.temp_override(view_layer=scene.view_layers.new("Background")):
        np.testing.assert_array_equal(settled(9 * BOX), np.float32(9 * BOX))
    np.testing.assert_array_equal(settled(1.5 * BOX), BOX)


def test_triangles_are_allotted_by_the_view_that_came_with_the_box(settled):
    steady = shot.steady(bpy.context.evaluated_depsgraph_get())
    looks = ((BOX, "first"), (1.5 * BOX, "second"), (9 * BOX, "third"))
    assert [steady(Framing(box, apparent)).apparent for box, apparent in looks] == ["first", "first", "third"]


@pytest.fixture
def moving(scene):
    """Frames 1 and 2 of a camera that draws near, and what there was to look at when it stood at each."""
    cube(scene), sun(scene)
    bpy.ops.mesh.primitive_uv_sphere_add(location=(2.5, 0, 0))
    mesh_object(scene, "Floor", [(-50, -50, -1), (50, -50, -1), (50, 50, -1), (-50, 50, -1)], [(0, 1, 2, 3)])
    scene.renderformer_v2.token_budget = 200
    scene.camera.rotation_euler.x = 1.4
    for frame, y in ((1, -9), (2, -7)):
        scene.camera.location = (0, y, 1)
        scene.camera.keyframe_insert("location", frame=frame)
    scene.frame_start, scene.frame_end = 1, 2
    scene.render.resolution_x = scene.render.resolution_y = 16
    return scene


def rendered(scene, tmp_path, frames):
    """What a job of these frames of the animation alone was fitted to, and its last picture."""
    scene.frame_start, scene.frame_end = frames

    def begun(*_):
        scene.frame_start, scene.frame_end = 1, 2  # as Blender's -f leaves them
    bpy.app.handlers.render_init.append(begun)
    scene.render.filepath = str(tmp_path / f"{frames}")
    scene.render.image_settings.file_format = "PNG"
    try:
        bpy.ops.render.render(animation=True)
    finally:
        bpy.app.handlers.render_init.remove(begun)
    picture = bpy.data.images.load(f"{tmp_path}/{frames}000{frames[1]}.png")
    return shot._kept[scene.name, "ViewLayer", "Camera"], np.array(picture.pixels)


def test_frames_rendered_apart_are_those_of_the_animation(moving, tmp_path):
    framing, picture = rendered(moving, tmp_path, (1, 2))
    alone, picture_alone = rendered(moving, tmp_path, (2, 2))
    np.testing.assert_array_equal(alone.box, framing.box)
    assert alone.shares == framing.shares and framing.shares
    np.testing.assert_allclose(picture_alone, picture, atol=2 / 255)


def test_a_camera_bound_to_a_marker_begins_its_shot_there(moving, tmp_path):
    moving.timeline_markers.new("Cut", frame=2).camera = bpy.data.objects["Camera"]
    cut, _ = rendered(moving, tmp_path, (2, 2))
    moving.timeline_markers.clear()
    first, _ = rendered(moving, tmp_path, (1, 1))
    assert np.abs(cut.box - first.box).max() > 0.1
