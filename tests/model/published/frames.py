# SPDX-License-Identifier: GPL-3.0-or-later
"""A prepared frame as the authors' add-on writes it (docs/scene-input.md 8.4), with every type of material."""
import json
from pathlib import Path

import numpy as np
from skimage.io import imsave

IDENTITY = {f"{what}_{axis}": value for what, value in (("translation", 0.0), ("rotation", 0.0), ("scale", 1.0))
            for axis in "xyz"} | {"normalize": False}
DIFFUSE = {"diffuse": [0.2, 0.4, 0.6], "specular": [0.1, 0.05, 0.02], "roughness": 0.3}
METALLIC = {"base_color": [0.7, 0.5, 0.3], "metallic": 0.25, "roughness": 0.4}
GLASS = {"base_color": [0.9, 0.8, 0.7], "metallic": 0.0, "roughness": 0.1, "transmission_weight": 1.0, "ior": 1.45}
LATENT = np.linspace(-0.8, 0.8, 9).astype(np.float32)
RADIANCE = [3000.0, 1500.0, 750.0]
CAMERAS = [{"position": [0.1, -2.0, 0.3], "look_at": [0.0, 0.0, 0.05], "up": [0.0, 0.0, 1.0], "fov": 37.5},
           {"position": [1.5, -1.0, 0.6], "look_at": [0.0, 0.1, 0.0], "up": [0.1, 0.0, 1.0], "fov": 50.0}]
VOLUME = {"translation_x": 0.1, "translation_y": -0.2, "translation_z": 0.3, "rotation_x": 10.0, "rotation_y": 20.0,
          "rotation_z": 30.0, "scale_x": 0.5, "scale_y": 0.5, "scale_z": 0.5, "normalize": True}
SCATTERING, ABSORPTION = [2.2, 2.6, 3.0], [0.1, 0.2, 0.3]
MAP = 256  # texels


def write(folder: Path, environment: bool = False, volume: bool = False) -> Path:
    """The frame's folder; the files of an environment and a volume are left to the caller."""
    (folder / "split").mkdir(parents=True)
    objects = {
        "floor": material("homo_diffuse_specular", diffuse_specular_params=DIFFUSE),
        "metal": material("homo_metallic_roughness", metallic_roughness_params=METALLIC),
        "glass": material("homo_metallic_roughness_transmission", metallic_roughness_transmission_params=GLASS),
        "measured": material("homo_measured_brdf", measured_brdf_npy_path="split/measured/latent.npy"),
        "cloth": material("svbrdf_diffuse_specular", texture_map_path="split/cloth", use_heightmap=True),
        "rust": material("svbrdf_metallic_roughness", texture_map_path="split/rust"),
        "lamp": material("homo_diffuse_specular", emissive=RADIANCE, diffuse_specular_params={
            "diffuse": [1.0] * 3, "specular": [0.0] * 3, "roughness": 1.0})}
    for i, name in enumerate(objects):
        write_square(folder / "split" / f"{name}.obj", (-0.4 + 0.1 * i, 0.05 * i, 0.1 * i))
    for name, maps in (("cloth", ("diffuse", "specular", "roughness", "normal", "height")),
                       ("rust", ("base_color", "metallic", "roughness", "normal"))):
        (folder / "split" / name).mkdir()
        for i, each in enumerate(maps):
            imsave(folder / "split" / name / f"{each}.png", pixels(i, each), check_contrast=False)
    (folder / "split" / "measured").mkdir()
    np.save(folder / "split" / "measured" / "latent.npy", LATENT)
    content = {
        "scene_name": "every-type", "version": "1.1.0",
        "objects": {name: {"mesh_path": f"split/{name}.obj", "transform": IDENTITY, "is_background": name == "floor",
                           "is_lighting": name == "lamp", "material": it} for name, it in objects.items()},
        "cameras": CAMERAS, "lighting": [],
        "env_map": {"env_map_path": "external/sky.exr", "rotation_x": 0.0, "rotation_y": 20.0, "rotation_z": 30.0,
                    "strength": 2.0} if environment else None,
        "volumes": [{"vdb_path": "external/smoke.vdb", "transform": VOLUME, "scattering_scale": SCATTERING,
                     "absorption_scale": ABSORPTION, "seed": 42, "transpose_written": True}] if volume else None,
        "wall_holes": None}
    (folder / "scene_config.json").write_text(json.dumps(content))
    return folder


def material(kind: str, **given) -> dict:
    return {"material_type": kind, "texture_map_path": None, "texture_map_aug_random_seed": None,
            "use_heightmap": False, "diffuse_specular_params": None, "metallic_roughness_params": None,
            "metallic_roughness_transmission_params": None, "emissive": [0.0] * 3, "smooth_shading": False,
            "rand_tri_diffuse_seed": None} | given


def pixels(seed: int, name: str) -> np.ndarray:
    """(MAP, MAP, 3) u8, smooth; a normal map that is a little bent, a height that rises to the right."""
    y, x = np.mgrid[:MAP, :MAP] / (MAP - 1)
    if name == "normal":
        return np.stack([128 + 20 * x, 128 - 10 * y, 250 + 0 * x], -1).astype(np.uint8)
    if name in ("diffuse", "specular", "base_color"):
        return np.stack([200 * x, 180 * y, 100 + 20 * seed + 0 * x], -1).astype(np.uint8)
    return np.repeat((60 + 20 * seed + 100 * x)[..., None], 3, -1).astype(np.uint8)


def write_square(file: Path, corner) -> None:
    """Two triangles in a plane z = constant, with private vertices, UVs from 0 to 1 and upright normals."""
    at = np.array([(0, 0), (1, 0), (1, 1), (0, 0), (1, 1), (0, 1)], float)
    lines = [f"v {corner[0] + 0.3 * x} {corner[1] + 0.3 * y} {corner[2]}" for x, y in at]
    lines += [f"vt {x} {y}" for x, y in at] + ["vn 0 0 1"] * 6
    lines += [f"f {a}/{a}/{a} {a + 1}/{a + 1}/{a + 1} {a + 2}/{a + 2}/{a + 2}" for a in (1, 4)]
    file.write_text("\n".join(lines) + "\n")
