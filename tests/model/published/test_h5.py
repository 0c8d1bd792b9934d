# SPDX-License-Identifier: GPL-3.0-or-later
"""The research code's scene file: what is written, and what a reader must put up with (docs/scene-input.md 8)."""
import json
from dataclasses import replace

import h5py
import numpy as np
import pytest

from renderformer_v2.model.environment import rotate_environment
from renderformer_v2.model.errors import SceneError
from renderformer_v2.model.published.h5 import VOLUMES, read_h5, write_h5
from renderformer_v2.model.published.processed_scene import ProcessedScene
from renderformer_v2.model.scene import Volumes

N, V, M = 5, 2, 3


def scene() -> ProcessedScene:
    random = np.random.default_rng(1)
    f32 = lambda *shape: random.random(shape, np.float32)  # noqa: E731
    cameras = np.tile(np.eye(4, dtype=np.float32), (V, 1, 1))
    cameras[1, :3, :3] = [[0, 0, 1], [1, 0, 0], [0, 1, 0]]
    cameras[:, :3, 3] = f32(V, 3)
    return ProcessedScene(
        f32(N, 3, 3), f32(N, 3, 3), f32(2, 80, 4, 4).astype(np.float16), np.array([0, 1, 1, 0, 1]),
        np.float32([[1e6, 2, 3]] + [[0, 0, 0]] * 4), f32(256, 512, 3),
        Volumes(f32(M, 64), *(f32(M, 3) for _ in range(5))), cameras, np.float32([30, 60]),
        f32(V, 8, 8, 4).astype(np.float16), {"scene_name": "five"})


def test_round_trip_and_layout(tmp_path):
    path, written = tmp_path / "scene.h5", scene()
    write_h5(path, written)
    assert [p.name for p in tmp_path.iterdir()] == ["scene.h5"]
    with h5py.File(path) as file:
        layout = {key: (item.dtype.name, item.shape) for key, item in file.items()}
        metadata = json.loads(file.attrs["export_metadata"])
    assert layout == {
        "triangles": ("float32", (N, 3, 3)), "vn": ("float32", (N, 3, 3)), "texture": ("float16", (N, 80, 4, 4)),
        "light_strength": ("float16", (N, 3)), "c2w": ("float32", (V, 4, 4)), "fov": ("float32", (V,)),
        "mvp": ("float32", (V, 4, 4)), "img": ("float16", (V, 8, 8, 4)), "env_map": ("float32", (3, 256, 512)),
        "volume_density": ("float32", (M, 64)), **{f"volume_{k}": ("float32", (M, 3)) for k in (
            "position", "rotation", "scale", "scattering_scale", "absorption_scale")}}
    assert metadata["format"] == "v2" and metadata["postprocessed"] and metadata["texture_encoder"] == "qwen_vae"
    assert metadata["scene_name"] == "five" and metadata["feature_set"] == ["env_map", "volume"]

    found = read_h5(path)
    np.testing.assert_array_equal(found.texture[found.texture_index], written.texture[written.texture_index])
    np.testing.assert_array_equal(found.light_strength[0], np.float32([65504, 2, 3]))
    for name in ("triangles", "normals", "environment", "camera_to_world", "fov", "image"):
        np.testing.assert_array_equal(getattr(found, name), getattr(written, name))
    for name in Volumes.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(found.volumes, name), getattr(written.volumes, name))


def edited(path, **arrays):
    """The file with datasets replaced, or removed where the value is None."""
    with h5py.File(path, "a") as file:
        for key, value in arrays.items():
            if key in file:
                del file[key]
            if value is not None:
                file[key] = value
    return path


@pytest.fixture
def stored(tmp_path):
    write_h5(tmp_path / "scene.h5", scene())
    return tmp_path / "scene.h5"


def test_optional_data_may_be_absent_or_empty(stored):
    found = read_h5(edited(stored, vn=None, mvp=None, img=None, env_map=np.zeros((0, 256, 512)), fov=np.ones((V, 1)),
                           volume_density=np.zeros((0, 64))))
    assert not found.normals.any() and found.environment is None and found.image is None and found.volumes is None
    assert found.fov.shape == (V,)


def test_raw_environment_is_rotated_and_scaled(stored):
    image = np.random.default_rng(2).random((256, 512, 4)).astype(np.float32)
    found = read_h5(edited(stored, env_map=image, env_map_rotation=[20.0, 30, 40], env_map_strength=[2.0]))
    np.testing.assert_array_equal(found.environment, rotate_environment(image, [20, 30, 40], 2.0))


def test_raw_texture_brings_its_own_light(stored):
    texture = np.zeros((N, 16, 32, 32), np.float16)
    texture[2, 12:15] = 300
    found = read_h5(edited(stored, texture=texture, light_strength=None))
    assert found.is_raw
    np.testing.assert_array_equal(found.light_strength.any(axis=1), np.arange(N) == 2)


def test_a_raw_file_has_the_same_volumes(stored):
    expected = read_h5(stored).volumes
    found = read_h5(edited(stored, volume_density=None, volume_data=expected.density.reshape(M, 4, 4, 4),
                           volume_indices=np.zeros(M, np.int32), voxel_indices=np.zeros((M, 3), np.int32))).volumes
    np.testing.assert_array_equal(found.density, expected.density)
    np.testing.assert_array_equal(found.position, expected.position)


def test_the_texture_of_version_1_brings_its_light_too(stored):
    texture = np.zeros((N, 13, 32, 32), np.float16)
    texture[3, 10:13] = 500
    found = read_h5(edited(stored, texture=texture, light_strength=None, env_map=None, volume_density=None, mvp=None))
    assert found.is_v1 and found.is_raw
    np.testing.assert_array_equal(found.light_strength, np.where(np.arange(N)[:, None] == 3, 500, 0).repeat(3, axis=1))


def test_row_of_zeros_is_no_volume(stored):
    zeros = {f"volume_{k}": np.zeros((1, 3)) for k in ("position", "rotation", "scale", "scattering_scale",
                                                       "absorption_scale")}
    assert read_h5(edited(stored, volume_density=np.zeros((1, 64)), **zeros)).volumes is None


def test_negative_light_is_stored_light(stored):
    """The network's input clamps it (docs/network.md 2, docs/scene-input.md 7.4)."""
    found = read_h5(edited(stored, light_strength=np.full((N, 3), -1.0), env_map=np.full((3, 256, 512), -1.0)))
    assert (found.light_strength == -1).all() and (found.environment == -1).all()


def test_any_byte_order_is_read_as_the_machines(stored):
    expected = read_h5(stored)
    with h5py.File(stored) as file:
        swapped = {key: item[()].astype(item.dtype.newbyteorder(">")) for key, item in file.items()}
    found = read_h5(edited(stored, **swapped))
    for name in ("triangles", "texture", "image"):
        array = getattr(found, name)
        assert array.dtype.isnative
        np.testing.assert_array_equal(array, getattr(expected, name))


def camera(*diagonal) -> np.ndarray:
    return np.stack([np.eye(4), np.diag([float(x) for x in diagonal])])


@pytest.mark.parametrize("change, message", [
    ({"triangles": None}, "triangles is missing"), ({"triangles": np.ones((0, 3, 3))}, "triangles is empty"),
    ({"c2w": None}, "c2w is missing"), ({"light_strength": None}, "light_strength is missing"),
    ({"volume_scale": None}, "volume_scale is missing"),
    ({"volume_density": None, "volume_data": np.ones((1, 8, 4, 8, 4, 8, 4))}, r"volume_data has shape .*\(M, 4, 4, 4"),
    ({"texture": np.ones((N, 80))}, "texture has shape"), ({"texture": np.ones((4, 80, 4, 4))}, r"expected \(5, 80"),
    ({"texture": np.ones((N, 12, 32, 32))}, "texture has shape"), ({"texture": np.ones((N, 64, 4, 4))}, "texture has"),
    ({"texture": np.ones((N, 80, 4, 8))}, "texture has shape"), ({"texture": np.ones((N, 16, 30, 30))}, "side 30"),
    ({"env_map": np.ones((3, 128, 256))}, "env_map has shape"), ({"fov": np.ones(V + 1)}, "fov has shape"),
    ({"triangles": np.ones(N)}, r"triangles has shape \(5,\), expected \(N, 3, 3\)"),
    ({"triangles": 1.0}, "triangles has shape"), ({"c2w": 1.0}, "c2w has shape"),
    ({"volume_density": 1.0}, "volume_density has shape"), ({"img": np.ones((V, 8, 4, 3))}, "img has shape"),
    ({"env_map": np.ones((256, 512, 3)), "env_map_rotation": [0.0, 0.0]}, "env_map_rotation has shape"),
    ({"triangles": np.ones((N, 3, 3), complex)}, "triangles holds no real numbers"),
    ({"light_strength": "bright"}, "light_strength holds no real numbers"), ({"fov": [b"wide"]}, "fov holds no real"),
    ({"triangles": np.ones((N, 3, 3))}, "none with an area"), ({"triangles": np.full((N, 3, 3), 1e300)}, "not finite"),
    ({"c2w": np.zeros((V, 4, 4))}, "c2w is not rigid for camera 0"), ({"c2w": camera(2, 2, 2, 1)}, "camera 1"),
    ({"c2w": camera(-1, 1, 1, 1)}, "c2w is not rigid"), ({"c2w": camera(1, 1, 1, 2)}, "c2w is not rigid"),
    ({"fov": [40, 0]}, "fov is 0 degrees for camera 1"), ({"fov": [180, 40]}, "fov is 180 degrees for camera 0"),
])
def test_unusable_files_are_refused_by_name(stored, change, message):
    with pytest.raises(SceneError, match=f"scene.h5: .*{message}.*: "):
        read_h5(edited(stored, **change))


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("key", [
    "triangles", "vn", "texture", "light_strength", "c2w", "fov", "env_map", *VOLUMES.values()])
def test_numbers_that_are_not_finite_are_refused_by_name(stored, key, value):
    with h5py.File(stored) as file:
        array = file[key][()]
    array.flat[1] = value
    with pytest.raises(SceneError, match=rf"scene.h5: {key} is not finite \(1 of {array.size} values"):
        read_h5(edited(stored, **{key: array}))


@pytest.mark.parametrize("change", [{"env_map_strength": [np.nan]}, {"env_map_rotation": [0, np.inf, 0]}])
def test_a_raw_environment_turns_by_finite_numbers_only(stored, change):
    with pytest.raises(SceneError, match=f"scene.h5: {list(change)[0]} is not finite"):
        read_h5(edited(stored, env_map=np.ones((256, 512, 3)), **change))


@pytest.mark.parametrize("text", [3.0, "{", "[1]", np.bytes_(b"\xff")])
def test_metadata_that_is_no_json_object_is_refused(stored, text):
    with h5py.File(stored, "a") as file:
        file.attrs["export_metadata"] = text
    with pytest.raises(SceneError, match="scene.h5: export_metadata .*: "):
        read_h5(stored)


@pytest.mark.parametrize("key, refused", [("vn", True), ("mvp", False)])
def test_a_damaged_chunk_is_named_unless_nobody_needs_it(stored, key, refused):
    with h5py.File(stored) as file:
        chunk = file[key].id.get_chunk_info(0)
    content = bytearray(stored.read_bytes())
    content[chunk.byte_offset:chunk.byte_offset + chunk.size] = bytes(chunk.size)
    stored.write_bytes(content)
    if refused:
        with pytest.raises(SceneError, match=f"scene.h5: {key} cannot be read .*: the file is damaged"):
            read_h5(stored)
    else:
        assert len(read_h5(stored).triangles) == N


@pytest.mark.parametrize("change, message", [
    ({"triangles": np.zeros((0, 3, 3))}, "one triangle"), ({"fov": np.zeros(0)}, "one camera"),
    ({"texture": np.zeros((2, 16, 32, 32))}, "encoded textures")])
def test_what_a_file_cannot_hold_is_not_written(tmp_path, change, message):
    with pytest.raises(SceneError, match=message):
        write_h5(tmp_path / "scene.h5", replace(scene(), **change))
    assert not list(tmp_path.iterdir())


def test_a_picture_is_not_a_scene(tmp_path):
    (tmp_path / "scene.h5").write_bytes(b"PNG")
    with pytest.raises(SceneError, match="not an H5 file"):
        read_h5(tmp_path / "scene.h5")
