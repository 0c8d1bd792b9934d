# SPDX-License-Identifier: GPL-3.0-or-later
"""The processed H5 scene file of the research code (spec/scene-input.md 8); h5py is imported only when it is used."""
from __future__ import annotations

import json
import os
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from .environment import rotate_environment
from .errors import SceneError
from .processed_scene import ProcessedScene
from .scene import ENVIRONMENT_SHAPE, Volumes

VOLUMES = {"density": "volume_density", "position": "volume_position", "rotation": "volume_rotation",
           "scale": "volume_scale", "scattering": "volume_scattering_scale", "absorption": "volume_absorption_scale"}
HALF_MAX = 65504.0


def write_h5(path: str | Path, scene: ProcessedScene) -> None:
    """Write a scene with at least one view whose texture is encoded, whole or not at all.

    Raises SceneError for a scene that the file cannot hold or without the package h5py, OSError as the disk does.
    """
    if not len(scene.triangles) or not len(scene.fov) or scene.is_raw:
        raise SceneError("an H5 scene needs at least one triangle, one camera and encoded textures")
    half = lambda x: np.clip(x, -HALF_MAX, HALF_MAX).astype(np.float16)  # noqa: E731
    arrays = {
        "triangles": np.float32(scene.triangles), "vn": np.float32(scene.normals),
        "texture": half(scene.texture)[scene.texture_index], "light_strength": half(scene.light_strength),
        "c2w": np.float32(scene.camera_to_world), "fov": np.float32(scene.fov),
        "mvp": np.zeros((len(scene.fov), 4, 4), np.float32)}
    if scene.environment is not None:
        arrays["env_map"] = np.float32(scene.environment).transpose(2, 0, 1)
    if scene.volumes is not None and len(scene.volumes):
        arrays |= {key: np.float32(getattr(scene.volumes, name)) for name, key in VOLUMES.items()}
    if scene.image is not None:
        arrays["img"] = half(scene.image)
    features = [name for name, present in (("env_map", "env_map" in arrays), ("volume", VOLUMES["density"] in arrays))
                if present]
    metadata = {"format": "v2", "schema_version": 2, "scene_name": Path(path).stem, "texture_export_mode": "raw_only",
                "texture_encoder": "qwen_vae", "postprocessed": True, "feature_set": features} | scene.metadata
    path = Path(path)
    partial = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with _h5py().File(partial, "w") as file:
            for name, array in arrays.items():
                file.create_dataset(name, data=array, compression="gzip", compression_opts=4)
            file.attrs["export_metadata"] = json.dumps(metadata, sort_keys=True)
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def read_h5(path: str | Path) -> ProcessedScene:
    """A processed scene, or a raw one whose texture is encoded when it is rendered.

    Raises SceneError naming the dataset that is missing or wrong.
    """
    path = Path(path)
    with _readable(path) as file:
        arrays = {key: item[()] for key, item in file.items() if getattr(item, "size", 0)}  # empty means absent
        metadata = json.loads(file.attrs.get("export_metadata", "{}"))
    for key in ("triangles", "texture", "c2w", "fov"):
        if key not in arrays:
            raise SceneError(f"{path} has no {key}: it is not a RenderFormer-V2 scene")
    if "volume_data" in arrays:
        raise SceneError(f"{path} holds unprocessed volumes (volume_data): convert it with the research code first")
    texture = arrays["texture"]
    n, views = len(arrays["triangles"]), len(arrays["c2w"])
    if texture.ndim != 4:
        raise SceneError(f"{path}: texture has shape {texture.shape}, expected (N, 80, 4, 4)")
    if "light_strength" not in arrays:
        if not 15 <= texture.shape[1] <= 16:
            raise SceneError(f"{path} has no light_strength, which a scene with encoded textures must have")
        arrays["light_strength"] = texture[:, 12:15, 0, 0]
    scene = ProcessedScene(
        triangles=_float(arrays, "triangles", (n, 3, 3), path),
        normals=_float(arrays, "vn", (n, 3, 3), path) if "vn" in arrays else np.zeros((n, 3, 3), np.float32),
        texture=texture, texture_index=np.arange(n),
        light_strength=_float(arrays, "light_strength", (n, 3), path), environment=_environment(arrays, path),
        volumes=_volumes(arrays, path), camera_to_world=_float(arrays, "c2w", (views, 4, 4), path),
        fov=_float(arrays | {"fov": arrays["fov"].reshape(-1)}, "fov", (views,), path), image=arrays.get("img"),
        metadata=metadata)
    if len(texture) != n:
        raise SceneError(f"{path}: texture has {len(texture)} rows for {n} triangles")
    return scene


def _float(arrays: dict, key: str, shape: tuple, path: Path) -> np.ndarray:
    if arrays[key].shape != shape:
        raise SceneError(f"{path}: {key} has shape {arrays[key].shape}, expected {shape}")
    return arrays[key].astype(np.float32)


def _environment(arrays: dict, path: Path) -> np.ndarray | None:
    """(256, 512, 3); channels last means not yet rotated and scaled."""
    if "env_map" not in arrays:
        return None
    image = arrays["env_map"].astype(np.float32)
    if image.ndim == 3 and image.shape[-1] in (3, 4):
        rotation = np.reshape(arrays.get("env_map_rotation", np.zeros(3)), 3)
        image = rotate_environment(image, rotation, float(np.ravel(arrays.get("env_map_strength", 1.0))[0]))
    elif image.ndim == 3 and image.shape[0] in (3, 4):
        image = np.ascontiguousarray(image[:3].transpose(1, 2, 0))
    if image.shape != ENVIRONMENT_SHAPE:
        raise SceneError(f"{path}: env_map has shape {arrays['env_map'].shape}, expected (3, 256, 512)")
    return image


def _volumes(arrays: dict, path: Path) -> Volumes | None:
    """Cells; the all-zero row that stands for "a volume without an occupied cell" is dropped."""
    if VOLUMES["density"] not in arrays:
        return None
    missing = [key for key in VOLUMES.values() if key not in arrays]
    if missing:
        raise SceneError(f"{path} has volume_density but no {', '.join(missing)}")
    m = len(arrays[VOLUMES["density"]])
    fields = {name: _float(arrays, key, (m, 64 if name == "density" else 3), path) for name, key in VOLUMES.items()}
    real = (fields["density"] != 0).any(axis=1) | (fields["scale"] != 0).any(axis=1)
    return Volumes(**{name: array[real] for name, array in fields.items()}) if real.any() else None


@contextmanager
def _readable(path: Path):
    if not path.is_file():
        raise SceneError(f"{path}: there is no such file")
    try:
        file = _h5py().File(path, "r")
    except OSError as error:
        raise SceneError(f"{path} is damaged or not an H5 file ({error})") from error
    with file:
        yield file


def _h5py():
    try:
        import h5py
    except ImportError as error:
        raise SceneError("h5py is needed to read and write H5 scenes: run `pip install h5py`") from error
    return h5py
