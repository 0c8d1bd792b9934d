# SPDX-License-Identifier: GPL-3.0-or-later
"""The H5 scene file of the research code: processed, raw, or of its first version (docs/scene-input.md 8)."""
from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np

from ..environment import rotate_environment
from ..errors import SceneError
from ..geometry import area_vectors
from ..pictures import to_half
from ..scene import Volumes
from .h5_datasets import Datasets, load_h5py, open_datasets
from .processed_scene import RAW_CHANNELS, ProcessedScene
from .v1_textures import V1

VOLUMES = {"density": "volume_density", "position": "volume_position", "rotation": "volume_rotation",
           "scale": "volume_scale", "scattering": "volume_scattering_scale", "absorption": "volume_absorption_scale"}
RAW_VOLUMES = "volume_data"  # density of the cells in files that are not processed
EMISSION = dict.fromkeys(RAW_CHANNELS, slice(12, 15)) | {len(V1): V1["emission"]}  # by the channels of raw tiles
RIGID = 1e-3  # how far a camera's axes may be from unit length and right angles


def write_h5(path: str | Path, scene: ProcessedScene) -> None:
    """Write a scene with at least one view whose texture is encoded, whole or not at all.

    Raises SceneError for a scene that the file cannot hold or without the package h5py, OSError as the disk does.
    """
    for lacking, what in ((not len(scene.triangles), "at least one triangle"),
                          (not len(scene.fov), "at least one camera"), (scene.is_raw, "encoded textures")):
        if lacking:
            raise SceneError(f"{path}: an H5 scene needs {what}")
    arrays = {
        "triangles": np.float32(scene.triangles), "vn": np.float32(scene.normals),
        "texture": to_half(scene.texture)[scene.texture_index], "light_strength": to_half(scene.light_strength),
        "c2w": np.float32(scene.camera_to_world), "fov": np.float32(scene.fov),
        "mvp": np.zeros((len(scene.fov), 4, 4), np.float32)}
    if scene.environment is not None:
        arrays["env_map"] = np.float32(scene.environment).transpose(2, 0, 1)
    if scene.volumes:
        arrays |= {key: np.float32(getattr(scene.volumes, name)) for name, key in VOLUMES.items()}
    if scene.image is not None:
        arrays["img"] = to_half(scene.image)
    features = [name for name, present in (("env_map", "env_map" in arrays), ("volume", VOLUMES["density"] in arrays))
                if present]
    metadata = {"format": "v2", "schema_version": 2, "scene_name": Path(path).stem, "texture_export_mode": "raw_only",
                "texture_encoder": "qwen_vae", "postprocessed": True, "feature_set": features} | scene.metadata
    path = Path(path)
    partial = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with load_h5py().File(partial, "w") as file:
            for name, array in arrays.items():
                file.create_dataset(name, data=array, compression="gzip", compression_opts=4)
            file.attrs["export_metadata"] = json.dumps(metadata, sort_keys=True)
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def read_h5(path: str | Path) -> ProcessedScene:
    """A processed scene, or a raw one or one of version 1, whose texture is encoded when it is rendered.

    Raises SceneError naming the dataset that is missing, damaged or wrong.
    """
    with open_datasets(Path(path)) as data:
        return _scene(data)


def _scene(data: Datasets) -> ProcessedScene:
    triangles = data.read("triangles", ("N", 3, 3))
    n = len(triangles)
    if not area_vectors(triangles.astype(np.float64)).any():
        raise data.error("triangles", f"has {n} rows, none with an area", "the corners of a triangle must differ")
    texture = _texture(data, n)
    if "light_strength" not in data and texture.shape[1] in EMISSION:
        light_strength = texture[:, EMISSION[texture.shape[1]], 0, 0].astype(np.float32)
    else:
        light_strength = data.read("light_strength", (n, 3))
    camera_to_world, fov = _cameras(data)
    views = len(fov)
    return ProcessedScene(
        triangles=triangles,
        normals=data.read("vn", (n, 3, 3)) if "vn" in data else np.zeros((n, 3, 3), np.float32),
        texture=texture, texture_index=np.arange(n), light_strength=light_strength, environment=_environment(data),
        volumes=_volumes(data), camera_to_world=camera_to_world, fov=fov,
        # Nothing is rendered from the picture, and float16 cannot hold every lamp: infinity may be in it.
        image=data.read("img", (views, "R", "R", 4), (views, "R", "R", 3), half=True, finite=False)
        if "img" in data else None,
        metadata=data.metadata("export_metadata"))


def _texture(data: Datasets, n: int) -> np.ndarray:
    """(n, 80, q, q) latents, or (n, 13 to 16, q, q) raw tiles that the VAE can halve three times; f16 or f32."""
    texture = data.read("texture", *((n, channels, "q", "q") for channels in (80, *EMISSION)), half=True)
    if texture.shape[1] in EMISSION and texture.shape[-1] % 8:
        raise data.error("texture", f"has raw tiles of side {texture.shape[-1]}", "store 32, or a multiple of 8")
    return texture


def _cameras(data: Datasets) -> tuple[np.ndarray, np.ndarray]:
    """(V, 4, 4) rigid camera-to-world and (V,) degrees."""
    camera_to_world = data.read("c2w", ("V", 4, 4))
    views = len(camera_to_world)
    fov = data.read("fov", (views,), (views, 1)).reshape(-1)
    for i, (matrix, degrees) in enumerate(zip(camera_to_world.astype(np.float64), fov)):
        axes = matrix[:3, :3]
        if not (np.abs(axes.T @ axes - np.eye(3)).max() <= RIGID and np.linalg.det(axes) > 0
                and np.abs(matrix[3] - (0, 0, 0, 1)).max() <= RIGID):
            raise data.error("c2w", f"is not rigid for camera {i}", "its columns are right, up, backward, position; "
                             "remove scale, shear and mirroring")
        if not 0 < degrees < 180:
            raise data.error("fov", f"is {degrees:g} degrees for camera {i}", "store an angle between 0 and 180")
    return camera_to_world, fov


def _environment(data: Datasets) -> np.ndarray | None:
    """(256, 512, 3); channels last means not yet rotated and scaled."""
    if "env_map" not in data:
        return None
    image = data.read("env_map", (3, 256, 512), (4, 256, 512), (256, 512, 3), (256, 512, 4))
    if image.shape[0] in (3, 4):
        return np.ascontiguousarray(image[:3].transpose(1, 2, 0))
    rotation, strength = np.zeros(3, np.float32), 1.0
    if "env_map_rotation" in data:
        rotation = data.read("env_map_rotation", (3,), (1, 3)).reshape(3)
    if "env_map_strength" in data:
        strength = data.read("env_map_strength", (1,), ()).item()
    return rotate_environment(image, rotation, strength)


def _volumes(data: Datasets) -> Volumes | None:
    """Cells; the all-zero row that stands for "a volume without an occupied cell" is dropped."""
    if VOLUMES["density"] in data:
        density = data.read(VOLUMES["density"], ("M", 64))
    elif RAW_VOLUMES in data:
        density = data.read(RAW_VOLUMES, ("M", 4, 4, 4), ("M", 64)).reshape(-1, 64)
    else:
        return None
    fields = {name: density if name == "density" else data.read(key, (len(density), 3))
              for name, key in VOLUMES.items()}
    real = (fields["density"] != 0).any(axis=1) | (fields["scale"] != 0).any(axis=1)
    return Volumes(**{name: array[real] for name, array in fields.items()}) if real.any() else None
