# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays of panoramic cameras against those of Cycles."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.camera import view_rays, visible_pixels
from bl_ext.user_default.renderformer_v2.model.errors import SceneError
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.camera.camera import convert_camera
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.fitting.apparent_size import measure_apparent_size
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.fitting.visible import VisiblePoints

from tests.rf2_engine.f12 import cube
from tests.rf2_engine.still_life import with_cycles

FISHEYE = {"panorama_type": "FISHEYE_EQUISOLID"}
POLYNOMIAL = {"panorama_type": "FISHEYE_LENS_POLYNOMIAL"}


@pytest.fixture
def inside(scene):
    """A camera inside a large box, turned."""
    cube(scene, location=(0.5, -0.3, 0.2)).scale = (4, 4, 4)
    scene.camera.location, scene.camera.rotation_euler = (0.3, 0.1, -0.2), (1.2, 0.3, 0.8)
    scene.camera.data.type = "PANO"
    scene.render.resolution_x, scene.render.resolution_y = 50, 40
    scene.view_layers[0].use_pass_position, scene.cycles.samples = True, 1
    return scene


def view_of(scene, border=None):
    bpy.context.view_layer.update()
    return convert_camera(bpy.context.evaluated_depsgraph_get(), scene.render.resolution_x, scene.render.resolution_y,
                          border)


def apart(scene, tmp_path):
    """(H, W) pixels, as in the middle, from what Cycles saw to a ray, 0 where it saw nothing; where one alone saw."""
    view = view_of(scene)
    away = with_cycles(scene, tmp_path)["ViewLayer.Position"].astype(float)
    hit = away.any(axis=-1)
    away -= view.camera_to_world[:3, 3]
    off = np.linalg.norm(view_rays(view)[1] - away / np.linalg.norm(away, axis=-1, keepdims=True), axis=-1)
    return np.where(hit & visible_pixels(view), off * view.longer_side / 2, 0), hit != visible_pixels(view)


@pytest.mark.parametrize("settings", [
    {"panorama_type": "EQUIRECTANGULAR"},
    {"panorama_type": "EQUIRECTANGULAR", "longitude_min": -1, "latitude_max": 0.7, "shift_x": 0.1, "shift_y": -0.2},
    {"panorama_type": "CENTRAL_CYLINDRICAL", "central_cylindrical_radius": 2, "central_cylindrical_range_v_max": 3},
    {"panorama_type": "EQUIANGULAR_CUBEMAP_FACE"},
    {"panorama_type": "MIRRORBALL"},
    {"panorama_type": "FISHEYE_EQUIDISTANT", "fisheye_fov": 4.5},
    FISHEYE | {"shift_x": 0.2},
    FISHEYE | {"sensor_fit": "VERTICAL", "fisheye_lens": 8, "fisheye_fov": 2.5},
    FISHEYE | {"sensor_fit": "HORIZONTAL", "sensor_width": 25},
    POLYNOMIAL, POLYNOMIAL | {"fisheye_polynomial_k1": -0.08, "fisheye_fov": 2.2}])
def test_pixels_look_where_those_of_cycles_look(inside, tmp_path, settings):
    for name, value in settings.items():
        setattr(inside.camera.data, name, value)
    for size, aspect, scale in (((50, 40), 1, (1, 1, 1)), ((40, 50), 1.5, (-1, 2, 1))):
        inside.render.resolution_x, inside.render.resolution_y = size
        inside.render.pixel_aspect_y, inside.camera.scale = aspect, scale
        off, differs = apart(inside, tmp_path)
        assert np.count_nonzero(off) > 400 and np.quantile(off, 0.99) < 0.01
        assert off.max() < (0.1 if settings["panorama_type"] == "MIRRORBALL" else 0.01)  # on the rim a pixel is wide
        assert differs.sum() <= 4  # on the rim


def test_a_border_shows_the_same_part(inside):
    whole, part = view_of(inside), view_of(inside, (10, 31, 5, 20))
    assert (part.width, part.height, part.picture_size) == (21, 15, whole.picture_size)
    np.testing.assert_array_equal(view_rays(part)[1], view_rays(whole)[1][20:35, 10:31])
    assert whole.wraps is False and part.wraps is False  # a fisheye
    inside.camera.data.panorama_type = "EQUIRECTANGULAR"
    assert view_of(inside).wraps and not view_of(inside, (10, 31, 0, 40)).wraps


def test_a_panorama_has_the_size_of_a_picture_of_90_degrees_that_is_as_fine(inside):
    inside.camera.data.panorama_type = "EQUIRECTANGULAR"
    inside.render.resolution_x, inside.render.resolution_y = 800, 400
    assert view_of(inside).longer_side == round(800 / np.pi)


def test_what_sees_all_around_has_nothing_behind_it_and_a_fisheye_has(inside):
    data, triangle = inside.camera.data, np.float64([(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0)])
    around = [np.array(inside.camera.location) + 3 * axis for axis in np.vstack([np.eye(3), -np.eye(3)])]
    corners = np.array([place + triangle for place in around])
    data.panorama_type = "EQUIRECTANGULAR"
    whole = view_of(inside)
    assert measure_apparent_size(whole, VisiblePoints(corners[:, 0], np.zeros(6, int))).is_inside(corners).all()
    data.panorama_type, data.fisheye_fov = "FISHEYE_EQUIDISTANT", 3
    half = view_of(inside)
    ahead = (corners[:, 0] - half.camera_to_world[:3, 3]) @ -half.camera_to_world[:3, 2] > 0
    seen = measure_apparent_size(half, VisiblePoints(corners[:, 0], np.zeros(6, int))).is_inside(corners)
    assert seen[ahead].all() and not seen.all()


def test_angles_that_leave_nothing_to_see_are_an_error_that_names_the_camera(inside):
    data = inside.camera.data
    data.panorama_type, data.latitude_min, data.latitude_max = "EQUIRECTANGULAR", 0.5, 0.5
    with pytest.raises(SceneError, match='"Camera" sees nothing.*angles'):
        view_of(inside)
