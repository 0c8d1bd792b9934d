# SPDX-License-Identifier: GPL-3.0-or-later
"""The network's box over the frames of a render job."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine import shot

BOX = np.float32([(-1, -1, 0), (1, 1, 2)])


@pytest.fixture
def settled(scene):
    shot._kept.clear()
    yield lambda box: shot.steady(bpy.context.evaluated_depsgraph_get())(np.float32(box), "this view")[0]
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
    assert [steady(box, view)[1] for box, view in ((BOX, "first"), (1.5 * BOX, "second"), (9 * BOX, "third"))] == [
        "first", "first", "third"]
