# SPDX-License-Identifier: GPL-3.0-or-later
"""The description of prepared frames, and their meshes."""
import json
import re

import numpy as np
import pytest

from renderformer_v2.model.errors import SceneError
from renderformer_v2.model.published.obj_mesh import read_obj, write_obj
from renderformer_v2.model.published.prepared_frame import (
    find_lfs_pointers,
    find_missing_files,
    read_frame,
    write_frame,
)
from tests.model.published import frames


def test_a_frame_is_read_as_it_was_written(tmp_path):
    frame = read_frame(frames.write(tmp_path / "frame", environment=True, volume=True))
    kinds = {key: it.material.kind for key, it in frame.objects.items()}
    assert kinds == {
        "floor": "homo_diffuse_specular", "metal": "homo_metallic_roughness",
        "glass": "homo_metallic_roughness_transmission", "measured": "homo_measured_brdf",
        "cloth": "svbrdf_diffuse_specular", "rust": "svbrdf_metallic_roughness", "lamp": "homo_diffuse_specular"}
    assert frame.objects["glass"].material.numbers == frames.GLASS
    assert frame.objects["cloth"].material.has_height and not frame.objects["rust"].material.has_height
    assert frame.objects["lamp"].is_light and frame.objects["lamp"].material.emission == tuple(frames.RADIANCE)
    assert frame.environment.rotation == (0, 20, 30) and frame.environment.strength == 2
    assert frame.volumes[0].scale == (0.5,) * 3 and frame.volumes[0].scattering == tuple(frames.SCATTERING)
    assert [camera.fov for camera in frame.cameras] == [37.5, 50]
    (tmp_path / "again").mkdir()
    write_frame(frame, tmp_path / "again")
    assert read_frame(tmp_path / "again") == frame


def test_files_that_are_not_there_are_named(tmp_path):
    folder = frames.write(tmp_path / "frame", environment=True, volume=True)
    (folder / "split" / "rust" / "metallic.png").unlink()
    assert find_missing_files(read_frame(folder), folder) == [
        "split/rust/metallic.png", "external/sky.exr", "external/smoke.vdb"]


@pytest.mark.parametrize("path, value, message", [
    (("objects", "floor", "material", "material_type"), "wood", "floor: material: material_type.*svbrdf.*\"wood\""),
    (("objects", "metal", "material", "metallic_roughness_params", "roughness"), "dull", "roughness.*a number"),
    (("objects", "metal", "material", "metallic_roughness_params"), None, "braces, found nothing"),
    (("objects", "floor", "mesh_path"), "../secret.obj", "mesh_path.*inside the frame"),
    (("objects", "floor", "mesh_path"), "C:\\secret.obj", "mesh_path.*inside the frame"),
    (("objects", "floor", "transform", "scale_x"), 2.0, "floor: transform.*world coordinates"),
    (("objects", "lamp", "material", "emissive"), [-1, 5, 0], "lamp: material: emissive.*not negative"),
    (("cameras", 0, "position", 1), 10 ** 400, "item 0: position: expected 3 numbers"),
    (("cameras", 0, "fov"), 180.0, "item 0: fov.*between 0 and 180"),
    (("cameras",), {}, "cameras: expected a list"), (("lighting",), [{}], "is_lighting"),
])
def test_what_is_wrong_in_a_frame_is_named(tmp_path, path, value, message):
    folder = frames.write(tmp_path / "frame")
    content = json.loads((folder / "scene_config.json").read_text())
    entry = content
    for key in path[:-1]:
        entry = entry[key]
    entry[path[-1]] = value
    (folder / "scene_config.json").write_text(json.dumps(content))
    with pytest.raises(SceneError) as raised:
        read_frame(folder)
    assert re.search(message, str(raised.value)) and "scene_config.json" in str(raised.value)


def test_a_mark_of_the_byte_order_is_no_damage(tmp_path):
    file = frames.write(tmp_path / "frame") / "scene_config.json"
    expected = read_frame(file.parent)
    file.write_bytes(b"\xef\xbb\xbf" + file.read_bytes())
    assert read_frame(file.parent) == expected


def test_pointers_of_a_clone_without_lfs_are_found(tmp_path):
    folder = frames.write(tmp_path / "frame")
    frame = read_frame(folder)
    assert find_lfs_pointers(frame, folder) == []
    for name in ("split/metal.obj", "split/rust/normal.png"):
        (folder / name).write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 7\n")
    (folder / "split/glass.obj").unlink()
    assert find_lfs_pointers(frame, folder) == ["split/metal.obj", "split/rust/normal.png"]


@pytest.mark.parametrize("text", [None, "{", "[]", "[" * 100000], ids=["none", "half", "list", "deep"])
def test_what_is_no_frame_is_refused(tmp_path, text):
    if text is not None:
        (tmp_path / "scene_config.json").write_text(text)
    with pytest.raises(SceneError, match=re.escape(str(tmp_path))):
        read_frame(tmp_path)


def test_triangles_survive_an_obj_file(tmp_path):
    rng = np.random.default_rng(1)
    corners, uv = rng.normal(size=(5, 3, 3)).astype(np.float32), rng.random((5, 3, 2)).astype(np.float32)
    normals = corners / np.linalg.norm(corners, axis=-1, keepdims=True)
    write_obj(tmp_path / "a.obj", corners, normals, uv)
    found = read_obj(tmp_path / "a.obj")
    np.testing.assert_array_equal(found.vertices[found.corner_vertex].reshape(5, 3, 3), corners)
    np.testing.assert_array_equal(found.uv.reshape(5, 3, 2), uv)
    np.testing.assert_array_equal(found.normals.reshape(5, 3, 3), normals)


def test_other_obj_files_are_read_too(tmp_path):
    """Quadrilaterals, indices from the end, vertices that are written twice, faces without area, no UVs."""
    (tmp_path / "a.obj").write_text("# a comment\no Thing\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 0\nvn 0 0 1\n"
                                    "usemtl none\nf -4//1 3//1 4//1 5//1\nf 1//1 2//1 5//1\ns off\n")
    found = read_obj(tmp_path / "a.obj")
    assert found.sizes.tolist() == [4] and len(found.vertices) == 4 and found.uv is None
    np.testing.assert_array_equal(found.vertices[found.corner_vertex], [(1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 0)])


@pytest.mark.parametrize("text, message", [("v 0 0 0\nf 1 x 1\n", "line 2"), ("v 0 0 zero\n", "line 1"),
                                           ("v 0 0 0\nf 1 2 3\n", "do not fit")])
def test_a_damaged_obj_file_is_named(tmp_path, text, message):
    (tmp_path / "a.obj").write_text(text)
    with pytest.raises(SceneError, match=f"a.obj.*{message}"):
        read_obj(tmp_path / "a.obj")
