# SPDX-License-Identifier: GPL-3.0-or-later
"""What a viewport looks at is where Blender draws it."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.camera import view_rays_at
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.camera.camera import convert_camera
from bl_ext.user_default.renderformer_v2.rf2_engine.viewport.region_view import RegionView
from mathutils import Vector

from tests.rf2_engine.viewport.views import depsgraph, through_camera

POINTS = np.float64([(0.3, 1, 0.2), (-0.4, 0.5, -0.3), (0, -1, 0)])
WIDTH, HEIGHT = 640, 400


@pytest.fixture
def space():
    """The settings of the 3D viewport in the file that Blender starts with; it looks at the cube."""
    bpy.ops.wm.read_factory_settings()
    window = bpy.context.window_manager.windows[0]
    return next(area.spaces.active for area in window.screen.areas if area.type == "VIEW_3D")


def of(space, **settings):
    return RegionView.read(WIDTH, HEIGHT, space.region_3d, space, bpy.context.scene, **settings)


def seen_at(view, points):
    """(k, 2) pixels from the top left at which a View shows points."""
    place = (points - view.camera_to_world[:3, 3]) @ view.camera_to_world[:3, :3]
    x, y = (place[:, :2] / -place[:, 2:]).T
    return np.stack([x * view.focal[0] + view.principal[0], view.principal[1] - y * view.focal[1]], axis=1)


def drawn_at(space, points):
    """The same, of Blender's own matrix."""
    clip = [space.region_3d.window_matrix @ space.region_3d.view_matrix @ Vector((*point, 1)) for point in points]
    across = np.array([(x / w, y / w) for x, y, _, w in clip])
    return (1 + across * (1, -1)) / 2 * (WIDTH, HEIGHT)


@pytest.mark.parametrize("divisor", [1, 4, 8])
def test_points_are_where_blender_draws_them(space, divisor):
    view = of(space).view(divisor, POINTS)
    larger = WIDTH / view.width, HEIGHT / view.height
    np.testing.assert_allclose(larger, divisor, rtol=0.5)
    np.testing.assert_allclose(seen_at(view, POINTS) * larger, drawn_at(space, POINTS), atol=0.05)


def test_coarse_pictures_have_sides_that_cost_the_network_nothing_in_vain(space):
    sizes = [of(space).picture_size(divisor) for divisor in (1, 2, 4, 8)]
    assert sizes == [(640, 400), (320, 192), (128, 128), (64, 50)]


def test_the_camera_shows_what_a_render_shows(scene):
    scene.camera.data.shift_x, scene.camera.data.shift_y, scene.camera.data.clip_start = 0.2, -0.1, 0.7
    bpy.context.view_layer.update()
    ours, render = through_camera(scene, 50, 37).view(1, POINTS), convert_camera(depsgraph(), 50, 37, None)
    for name in ("camera_to_world", "focal", "principal", "clip_start"):
        np.testing.assert_allclose(getattr(ours, name), getattr(render, name), rtol=1e-4, atol=1e-4)


def test_orthographic_views_are_seen_from_afar_and_keep_their_scale(scene):
    scene.camera.data.type, scene.camera.data.ortho_scale, scene.camera.data.shift_x = "ORTHO", 4, 0.25
    bpy.context.view_layer.update()
    flat = np.float64([(x, 0, z) for x in (-1, 2) for z in (-1, 1)])
    view = through_camera(scene, 400, 200).view(1, flat)
    expected = np.stack([200 + (flat[:, 0] - 1) * 100, 100 - flat[:, 2] * 100], axis=1)
    np.testing.assert_allclose(seen_at(view, flat), expected, atol=0.5)
    rays = view_rays_at(view, np.array([0.5, 399.5]), np.array([0.5, 199.5]))[1]
    assert (rays[0] @ rays[1]) > 0.999


def test_a_part_shows_the_pixels_of_the_whole(scene):
    whole, part = through_camera(scene, 640, 400), through_camera(scene, 640, 400, (160, 480, 40, 240))
    a, b = whole.view(1, POINTS), part.view(1, POINTS)
    assert (b.width, b.height) == (320, 200)
    np.testing.assert_allclose(seen_at(b, POINTS) + (160, 400 - 240), seen_at(a, POINTS), atol=1e-2)


def test_borders_and_pixel_size_are_those_of_blender(space):
    scene = bpy.context.scene
    assert of(space).rectangle == (0, WIDTH, 0, HEIGHT)
    space.use_render_border = True
    space.render_border_min_x, space.render_border_max_x = 0.25, 0.5
    space.render_border_min_y, space.render_border_max_y = 0.5, 1.0
    assert of(space).rectangle == (160, 320, 200, 400)
    scene.render.preview_pixel_size = "2"
    assert of(space).picture_size(1) == (80, 100) and of(space).picture_size(4) == (20, 25)
    scene.render.preview_pixel_size = "AUTO"
    assert of(space, interface_pixel=2.0).pixel_size == 2 and of(space).pixel_size == 1


def test_a_render_border_is_a_part_of_the_cameras_frame(space):
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = 400, 400
    scene.render.use_border = True
    scene.render.border_min_x = scene.render.border_min_y = 0.5
    camera = scene.camera.evaluated_get(depsgraph())
    projection = camera.calc_matrix_camera(depsgraph(), x=WIDTH, y=HEIGHT)

    class OfCamera:  # the numbers of a RegionView3D that a script cannot set without a window
        view_perspective = "CAMERA"
        window_matrix, view_matrix = projection, camera.matrix_world.inverted()
    x0, x1, y0, y1 = RegionView.read(WIDTH, HEIGHT, OfCamera, space, scene).rectangle
    # The frame is a square as wide as the region, of which the part above and below is not seen.
    assert (x0, x1) == (WIDTH // 2, WIDTH) and (y0, y1) == (HEIGHT // 2, HEIGHT)
