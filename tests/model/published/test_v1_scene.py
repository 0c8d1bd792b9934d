# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes of the first RenderFormer become prepared frames."""
import numpy as np
import pytest
from skimage.io import imread

from renderformer_v2.model.errors import SceneError
from renderformer_v2.model.published.obj_mesh import read_obj
from renderformer_v2.model.published.prepared_frame import find_missing_files, read_frame
from renderformer_v2.model.published.v1_scene import convert_v1_scene, find_smooth_parts
from tests.model.published.v1_scenes import CUBE, MATERIAL, STILL, write_scene


def converted(tmp_path, *arguments, **more):
    remarks = convert_v1_scene(write_scene(tmp_path / "v1", *arguments, **more), tmp_path / "frame")
    frame = read_frame(tmp_path / "frame")
    assert find_missing_files(frame, tmp_path / "frame") == []
    return frame, read_obj(tmp_path / "frame" / frame.objects["cube"].mesh), remarks


def test_a_scene_keeps_its_materials_and_cameras(tmp_path):
    frame, mesh, remarks = converted(tmp_path)
    material = frame.objects["cube"].material
    assert (frame.name, material.kind, material.is_smooth, remarks) == ("one cube", "homo_diffuse_specular", True, [])
    assert material.numbers == {"diffuse": [0.8, 0.4, 0.2], "specular": [0.1] * 3, "roughness": 0.3}
    assert frame.cameras[0].fov == 40 and frame.cameras[0].position == (0, -2, 0)
    assert len(mesh.sizes) == 12 and len(mesh.vertices) == 8 and mesh.normals is None


def test_an_object_is_turned_then_scaled_then_moved(tmp_path):
    transform = {"translation": [10, 0, 0], "rotation": [90, 0, 90], "scale": [1, 2, 3], "normalize": False}
    _, mesh, _ = converted(tmp_path, transform)
    # x -> y -> 2 y; y -> z -> 3 z; z -> -y -> x
    expected = {(10 + z, 2 * x, 3 * y) for x, y, z in CUBE}
    assert {tuple(np.round(vertex, 4)) for vertex in mesh.vertices.tolist()} == expected


def test_a_normalised_object_fills_a_sphere_of_diameter_1(tmp_path):
    _, mesh, _ = converted(tmp_path, STILL | {"normalize": True})
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), 0.5, rtol=1e-5)


@pytest.mark.parametrize("kind, colors", [("per-triangle", 12), ("per-shading-group", 6)])
def test_random_colors_are_those_of_the_seed(tmp_path, kind, colors):
    material = MATERIAL | {"rand_tri_diffuse_seed": 3, "random_diffuse_max": 0.5, "random_diffuse_type": kind}
    frame, mesh, _ = converted(tmp_path, STILL, material)
    image = imread(tmp_path / "frame" / frame.objects["cube"].material.folder / "diffuse.png")
    u, v = mesh.uv.reshape(-1, 3, 2)[:, 0].T * 256
    shown = image[(256 - v).astype(int), u.astype(int)]
    drawn = np.random.RandomState(3).randint(0, 128, (colors, 3))
    assert {tuple(color) for color in shown.tolist()} == {tuple(color) for color in drawn.tolist()}
    np.testing.assert_array_equal(shown[0], drawn[0])
    assert (mesh.uv.reshape(-1, 3, 2) == mesh.uv.reshape(-1, 3, 2)[:, :1]).all()


def test_smooth_parts_end_at_edges_of_more_than_30_degrees():
    angles = np.radians([0, 20, 40, 80])
    line = np.concatenate([[(0, 0)], np.cumsum(np.stack([np.cos(angles), np.sin(angles)], 1), axis=0)])
    strips = [[(*line[i], 0), (*line[i + 1], 0), (*line[i], 1)] for i in range(4)]
    strips += [[(*line[i + 1], 0), (*line[i + 1], 1), (*line[i], 1)] for i in range(4)]
    np.testing.assert_array_equal(find_smooth_parts(np.float32(strips)), [0, 0, 0, 1] * 2)


def test_what_is_left_out_is_said(tmp_path):
    assert converted(tmp_path, remesh=True)[2] == [
        "cube: its remesh is left out, its triangles are those of the file"]


@pytest.mark.parametrize("change, message", [
    ({"material": {}}, "cube: material: diffuse: expected 3 numbers"), ({"transform": {}}, "cube: transform: rotation"),
    ({"mesh_path": "../cube.obj"}, "cube: mesh_path.*inside")])
def test_what_is_wrong_in_a_scene_is_named(tmp_path, change, message):
    with pytest.raises(SceneError, match=f"scene.json: objects: {message}"):
        converted(tmp_path, **change)
