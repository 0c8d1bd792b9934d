# SPDX-License-Identifier: GPL-3.0-or-later
"""View against Blender's own projection."""
from itertools import product

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view

from bl_ext.user_default.renderformer_v2.model.errors import SceneError
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.camera.camera import convert_camera
from mathutils import Matrix, Vector

from tests.rf2_engine.still_life import with_cycles

PLACE = Vector((3, -4, 2))
POINTS = [Vector(p) for p in ((0, 0, 0), (1, 0.5, -0.3), (-0.7, 0.2, 0.9), (0.1, -1, 0.4))]


def view_of(scene, size, border=None, report=None):
    bpy.context.view_layer.update()
    return convert_camera(bpy.context.evaluated_depsgraph_get(), *size, border, report)


def project(view, point):
    """(2,) pixel position of a world point, by the definition of View."""
    x, y, z, _ = np.linalg.inv(view.camera_to_world.astype(float)) @ (*point, 1)
    return view.focal * (x, -y) / -z + view.principal


def blender_pixels(scene, size, point):
    x, y, _ = world_to_camera_view(scene, scene.camera, point)
    return np.array([x * size[0], (1 - y) * size[1]])


@pytest.mark.parametrize("fit", ["AUTO", "HORIZONTAL", "VERTICAL"])
@pytest.mark.parametrize("size", [(64, 64), (80, 45), (45, 81)])
def test_projection_is_blenders(scene, fit, size):
    camera = scene.camera
    camera.data.sensor_fit = fit
    scene.render.resolution_x, scene.render.resolution_y = size
    for aspect, shift, scale in product([(1, 1), (2, 1), (1, 1.5)], [(0, 0), (0.2, -0.1)],
                                        [(1, 1, 1), (2, 3, 4), (-1, 1, 1), (1, -2, 1)]):
        scene.render.pixel_aspect_x, scene.render.pixel_aspect_y = aspect
        camera.data.shift_x, camera.data.shift_y = shift
        camera.matrix_world = Matrix.LocRotScale(PLACE, PLACE.to_track_quat("Z", "Y"), Vector(scale))
        view = view_of(scene, size)
        rotation = view.camera_to_world[:3, :3]
        np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-5)
        assert np.linalg.det(rotation) == pytest.approx(1, abs=1e-5)
        for point in POINTS:
            np.testing.assert_allclose(project(view, point), blender_pixels(scene, size, point), atol=2e-3)


PERSPECTIVE = {"lens": 40}
ORTHOGRAPHIC = {"type": "ORTHO", "ortho_scale": 7}


@pytest.mark.parametrize("size, aspect, settings", [
    ((50, 37), (1, 1), PERSPECTIVE | {"sensor_fit": "AUTO"}),
    ((37, 50), (2, 1), PERSPECTIVE | {"sensor_fit": "HORIZONTAL", "shift_x": 0.3}),
    ((50, 37), (1, 1.5), PERSPECTIVE | {"sensor_fit": "VERTICAL", "sensor_height": 20, "shift_y": -0.2}),
    ((50, 37), (1, 1), ORTHOGRAPHIC | {"shift_x": 0.2, "shift_y": 0.1}),
    ((37, 50), (1, 2), ORTHOGRAPHIC | {"sensor_fit": "VERTICAL"})])
def test_pixels_see_what_those_of_cycles_see(scene, add_mesh, tmp_path, size, aspect, settings):
    add_mesh("ground", [(-90, -90, 0), (90, -90, 0), (90, 90, 0), (-90, 90, 0)], [(0, 1, 2, 3)])
    add_mesh("near", [(-1, -1, 1), (1, -1, 1), (0, 1, 1.5)])
    for name, value in settings.items():
        setattr(scene.camera.data, name, value)
    scene.camera.matrix_world = Matrix.LocRotScale(PLACE, (PLACE - Vector((0.3, 0, 0.5))).to_track_quat("Z", "Y"),
                                                   (1, 1, 1))
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.render.pixel_aspect_x, scene.render.pixel_aspect_y = aspect
    scene.view_layers[0].use_pass_position, scene.cycles.samples = True, 1
    view = view_of(scene, size)
    seen = with_cycles(scene, tmp_path)["ViewLayer.Position"].astype(float)
    rows, columns = np.nonzero(seen.any(axis=-1))
    close = np.linalg.norm(seen[rows, columns], axis=-1) < 3  # where an orthographic camera's stand-in is as exact
    rows, columns = rows[close], columns[close]
    assert len(rows) > 100
    found = np.array([project(view, point) for point in seen[rows, columns]])
    np.testing.assert_allclose(found, np.stack([columns, rows], axis=1) + 0.5, atol=1 if "type" in settings else 0.02)


def test_border_moves_the_principal_point(scene):
    size = (50, 37)
    whole, part = view_of(scene, size), view_of(scene, size, (10, 31, 5, 20))
    assert (part.width, part.height) == (21, 15) and part.picture_size == whole.picture_size == 50
    np.testing.assert_allclose(part.principal, whole.principal - (10, 37 - 20))
    np.testing.assert_array_equal(part.focal, whole.focal)


def test_orthographic_camera_keeps_its_framing_and_is_reported(scene, report, add_mesh):
    add_mesh("object", [(-1, 0, -1), (1, 0, -1), (0, 0, 1)])
    scene.camera.data.type, scene.camera.data.ortho_scale, scene.camera.data.shift_x = "ORTHO", 4, 0.1
    view = view_of(scene, (50, 37), report=report)
    for point in (Vector((-1, 0, -1)), Vector((1, 0, 0.5)), Vector((0, 0, 1))):
        np.testing.assert_allclose(project(view, point), blender_pixels(scene, (50, 37), point), atol=2e-2)
    assert report.entries[0][:2] == ("approximated", "Camera")
    moved = view.camera_to_world[:3, 3] - np.array(scene.camera.matrix_world.translation)
    before = moved @ view.camera_to_world[:3, 2]
    assert view.clip_start == pytest.approx(before + scene.camera.data.clip_start, rel=1e-4)


def test_impossible_cameras_are_errors_that_name_them(scene):
    scene.camera.data.type = "CUSTOM"
    with pytest.raises(SceneError, match='"Camera" is custom.* Perspective, Orthographic or Panoramic'):
        view_of(scene, (50, 37))
    scene.camera.data.type, scene.camera.data.clip_start, scene.camera.data.clip_end = "PERSP", 5, 5
    with pytest.raises(SceneError, match="Clip End beyond its Clip Start"):
        view_of(scene, (50, 37))
    scene.camera = None
    with pytest.raises(SceneError, match="no camera"):
        view_of(scene, (50, 37))


def test_eye_in_place_of_an_orthographic_camera_is_behind_hair_too(scene, add_mesh):
    scene.camera.data.type, scene.camera.data.ortho_scale, scene.camera.data.clip_end = "ORTHO", 0.1, 5000
    add_mesh("far", [(-9, 500, -9), (9, 500, -9), (0, 500, 9)])
    curves = bpy.data.hair_curves.new("Hair")
    curves.add_curves([2])
    curves.points.foreach_set("position", np.float32([0, 0, 0, 0, 0, 0.01]))
    scene.collection.objects.link(bpy.data.objects.new("Hair", curves))
    assert view_of(scene, (50, 37)).camera_to_world[1, 3] < -5


def test_eye_in_place_of_an_orthographic_camera_is_behind_all_that_it_sees(scene, add_mesh):
    scene.camera.data.type, scene.camera.data.ortho_scale, scene.camera.data.clip_end = "ORTHO", 2, 5000
    scene.camera.matrix_world = Matrix.Translation((0, -600, 20)) @ Matrix.Rotation(1.5, 4, "X")
    add_mesh("ground", [(-900, -900, 0), (900, -900, 0), (900, 900, 0), (-900, 900, 0)], [(0, 1, 2, 3)])
    near = Vector((0, -590, 19.3))  # 10 m before the camera; what is seen of the ground is 280 m away
    add_mesh("near", [near, near + Vector((0.1, 0, 0)), near + Vector((0, 0, 0.1))])
    view = view_of(scene, (50, 37))
    ahead = -view.camera_to_world[:3, 2] @ (np.array(near) - view.camera_to_world[:3, 3])
    assert ahead > 0
    np.testing.assert_allclose(project(view, near), blender_pixels(scene, (50, 37), near), atol=2)


def test_what_an_orthographic_camera_does_not_see_does_not_move_its_eye(scene, add_mesh):
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 4
    add_mesh("object", [(-1, 0, -1), (1, 0, -1), (0, 0, 1)])
    alone = view_of(scene, (50, 37))
    add_mesh("nowhere").matrix_world = Matrix.Translation((float("nan"), 0, 0))
    add_mesh("behind", [(-1, -900, -1), (1, -900, -1), (0, -900, 1)])
    add_mesh("beside", [(300, 500, -1), (301, 500, -1), (300, 500, 1)])
    add_mesh("wall through the camera", [(1, -900, -9), (1, 0, -9), (1, 0, 9), (1, -900, 9)], [(0, 1, 2, 3)])
    np.testing.assert_allclose(view_of(scene, (50, 37)).camera_to_world[:3, 3], alone.camera_to_world[:3, 3], atol=3)
