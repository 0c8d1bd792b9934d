# SPDX-License-Identifier: GPL-3.0-or-later
"""The research code's scene file: what is written, and what a reader must put up with (spec/scene-input.md 8)."""
import json

import h5py
import numpy as np
import pytest

from model.environment import rotate_environment
from model.errors import SceneError
from model.h5 import read_h5, write_h5
from model.processed_scene import ProcessedScene
from model.scene import Volumes

N, V, M = 5, 2, 3


def scene() -> ProcessedScene:
    random = np.random.default_rng(1)
    f32 = lambda *shape: random.random(shape, np.float32)  # noqa: E731
    return ProcessedScene(
        f32(N, 3, 3), f32(N, 3, 3), f32(2, 80, 4, 4).astype(np.float16), np.array([0, 1, 1, 0, 1]),
        np.float32([[1e6, 2, 3]] + [[0, 0, 0]] * 4), f32(256, 512, 3),
        Volumes(f32(M, 64), *(f32(M, 3) for _ in range(5))), f32(V, 4, 4), np.float32([30, 60]),
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


def test_row_of_zeros_is_no_volume(stored):
    zeros = {f"volume_{k}": np.zeros((1, 3)) for k in ("position", "rotation", "scale", "scattering_scale",
                                                       "absorption_scale")}
    assert read_h5(edited(stored, volume_density=np.zeros((1, 64)), **zeros)).volumes is None


@pytest.mark.parametrize("change, message", [
    ({"c2w": None}, "no c2w"), ({"light_strength": None}, "no light_strength"),
    ({"volume_scale": None}, "no volume_scale"), ({"volume_data": np.ones((1, 4, 4, 4))}, "volume_data"),
    ({"texture": np.ones((N, 80))}, "texture has shape"), ({"texture": np.ones((N - 1, 80, 4, 4))}, "4 rows for 5"),
    ({"env_map": np.ones((3, 128, 256))}, "env_map has shape"), ({"fov": np.ones(V + 1)}, "fov has shape"),
])
def test_unusable_files_are_refused_by_name(stored, change, message):
    with pytest.raises(SceneError, match=message):
        read_h5(edited(stored, **change))


def test_a_picture_is_not_a_scene(tmp_path):
    (tmp_path / "scene.h5").write_bytes(b"PNG")
    with pytest.raises(SceneError, match="not an H5 file"):
        read_h5(tmp_path / "scene.h5")
