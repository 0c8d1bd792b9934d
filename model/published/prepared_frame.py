# SPDX-License-Identifier: GPL-3.0-or-later
"""A prepared frame of the research code: scene_config.json beside meshes and maps (docs/scene-input.md 8.4)."""
from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

from ..errors import SceneError
from ..weights.files import is_lfs_pointer
from .entries import Entry, read_json_file

CONFIG, MESHES = "scene_config.json", "split"
VERSION = "2.0.0"
# By material type: the entry that holds its numbers, and how many each of them has.
NUMBERS = {
    "homo_diffuse_specular": ("diffuse_specular_params", {"diffuse": 3, "specular": 3, "roughness": 1}),
    "homo_metallic_roughness": ("metallic_roughness_params", {"base_color": 3, "metallic": 1, "roughness": 1}),
    "homo_metallic_roughness_transmission": ("metallic_roughness_transmission_params", {
        "base_color": 3, "metallic": 1, "roughness": 1, "transmission_weight": 1, "ior": 1})}
MAPS = {"svbrdf_diffuse_specular": ("diffuse", "specular", "roughness", "normal"),
        "svbrdf_metallic_roughness": ("basecolor", "metallic", "roughness", "normal")}
MEASURED = "homo_measured_brdf"
HEIGHT = "height"
ALSO = {"basecolor": "base_color"}  # another name that the file of a map may have


@dataclass
class FrameMaterial:
    kind: str                                              # a key of NUMBERS or MAPS, or MEASURED
    numbers: dict[str, float | list[float]] = field(default_factory=dict)  # by name, as NUMBERS has them
    folder: str | None = None                              # of the maps, in the frame
    has_height: bool = False
    latent: str | None = None                              # .npy of nine numbers, in the frame
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)  # radiance
    is_smooth: bool = True
    diffuse_seed: int | None = None                        # of a random diffuse colour for each group of triangles


@dataclass
class FrameObject:
    mesh: str           # OBJ in the frame, world coordinates
    material: FrameMaterial
    is_background: bool = False
    is_light: bool = False


@dataclass
class FrameCamera:
    position: tuple[float, float, float]
    look_at: tuple[float, float, float]
    up: tuple[float, float, float]
    fov: float          # degrees, of the square picture


@dataclass
class FrameEnvironment:
    image: str          # in the frame
    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)  # degrees, Blender's Mapping node
    strength: float = 1.0


@dataclass
class FrameVolume:
    grid: str           # .vdb in the frame
    translation: tuple[float, float, float]
    rotation: tuple[float, float, float]  # degrees, Euler XYZ
    scale: tuple[float, float, float]
    scattering: tuple[float, float, float]
    absorption: tuple[float, float, float]
    is_transposed: bool = True
    seed: int = 0


@dataclass
class PreparedFrame:
    name: str
    objects: dict[str, FrameObject]
    cameras: list[FrameCamera]
    environment: FrameEnvironment | None = None
    volumes: list[FrameVolume] = field(default_factory=list)
    wall_holes: dict = field(default_factory=dict)  # as the file has them, by object


def read_frame(folder: Path) -> PreparedFrame:
    """The description of a frame; whether what it names is there is left to `find_missing_files`.

    Raises SceneError naming the file, the entry in it, and what was expected.
    """
    try:
        return read_json_file(Path(folder) / CONFIG, FrameEntry).frame()
    except FileNotFoundError as error:
        raise SceneError(f"{folder} is no prepared frame: there is no {CONFIG} in it. Choose the folder that holds "
                         "that file") from error


def list_files(frame: PreparedFrame, folder: Path) -> list[str]:
    """All files that the frame consists of, by their names in its folder."""
    names = [item.mesh for item in frame.objects.values()]
    for item in frame.objects.values():
        names += [] if item.material.latent is None else [item.material.latent]
        maps = (map_file(folder, item.material, name) for name in list_maps(item.material))
        names += [file.relative_to(folder).as_posix() for file in maps]
    names += [frame.environment.image] if frame.environment else []
    names += [volume.grid for volume in frame.volumes]
    return list(dict.fromkeys(names))


def find_missing_files(frame: PreparedFrame, folder: Path) -> list[str]:
    """Those of its files that are missing."""
    return [name for name in list_files(frame, folder) if not (Path(folder) / name).is_file()]


def find_lfs_pointers(frame: PreparedFrame, folder: Path) -> list[str]:
    """Those of its files that are texts of Git LFS in place of the real ones. Raises OSError."""
    present = set(list_files(frame, folder)) - set(find_missing_files(frame, folder))
    return sorted(name for name in present if is_lfs_pointer(Path(folder) / name))


def list_maps(material: FrameMaterial) -> tuple[str, ...]:
    """Names of the maps that the material has."""
    return MAPS.get(material.kind, ()) + (HEIGHT,) * material.has_height


def map_file(folder: Path, material: FrameMaterial, name: str) -> Path:
    file = Path(folder) / material.folder / f"{name}.png"
    other = file.with_stem(ALSO.get(name, name))
    return other if other.is_file() and not file.is_file() else file


def write_frame(frame: PreparedFrame, folder: Path) -> None:
    """The description alone. Raises OSError as the disk does."""
    volumes = [{"vdb_path": item.grid, "transform": _transform(item.translation, item.rotation, item.scale),
                "scattering_scale": list(item.scattering), "absorption_scale": list(item.absorption), "seed": item.seed,
                "transpose_written": item.is_transposed} for item in frame.volumes]
    environment = frame.environment and {"env_map_path": frame.environment.image} | {
        f"rotation_{axis}": angle for axis, angle in zip("xyz", frame.environment.rotation)} | {
        "strength": frame.environment.strength}
    content = {
        "scene_name": frame.name, "version": VERSION,
        "objects": {key: {"mesh_path": item.mesh, "transform": _transform(), "is_background": item.is_background,
                          "is_lighting": item.is_light, "material": _material(item.material)}
                    for key, item in frame.objects.items()},
        "cameras": [{"position": list(camera.position), "look_at": list(camera.look_at), "up": list(camera.up),
                     "fov": camera.fov} for camera in frame.cameras],
        "lighting": [], "env_map": environment, "volumes": volumes or None, "wall_holes": frame.wall_holes or None}
    (Path(folder) / CONFIG).write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def _transform(translation=(0.0,) * 3, rotation=(0.0,) * 3, scale=(1.0,) * 3) -> dict:
    vectors = {"translation": translation, "rotation": rotation, "scale": scale}
    return {f"{name}_{axis}": float(value) for name, values in vectors.items()
            for axis, value in zip("xyz", values)} | {"normalize": False}


def _material(material: FrameMaterial) -> dict:
    numbers = {key: material.numbers if kind == material.kind else None for kind, (key, _) in NUMBERS.items()}
    return {"material_type": material.kind, "texture_map_path": material.folder, "texture_map_aug_random_seed": None,
            "use_heightmap": material.has_height, **numbers, "measured_brdf_npy_path": material.latent,
            "emissive": list(material.emission), "smooth_shading": material.is_smooth,
            "rand_tri_diffuse_seed": material.diffuse_seed}


class FrameEntry(Entry):
    """One value of the description."""

    def frame(self) -> PreparedFrame:
        if self["lighting"].value:
            raise self["lighting"].wrong("an empty list: lamps are objects with is_lighting")
        environment, volumes = self["env_map"], self["volumes"]
        return PreparedFrame(
            self["scene_name"].text(default="RenderFormer Scene"),
            {key: entry.object() for key, entry in self["objects"].named()},
            [entry.camera() for entry in self["cameras"].items()],
            None if environment.value is None else environment.environment(),
            [] if volumes.value is None else [entry.volume() for entry in volumes.items()],
            {} if self["wall_holes"].value is None else self["wall_holes"].mapping())

    def object(self) -> FrameObject:
        if "transform" in self.mapping() and self["transform"].transform() != _IDENTITY:
            raise self["transform"].wrong("no transform: the meshes of a frame hold world coordinates")
        return FrameObject(self["mesh_path"].path(), self["material"].material(), self["is_background"].flag(),
                           self["is_lighting"].flag())

    def material(self) -> FrameMaterial:
        kind, material = self["material_type"].text(), FrameMaterial("")
        if kind in NUMBERS:
            key, counts = NUMBERS[kind]
            material.numbers = {name: self[key][name].numbers(count) for name, count in counts.items()}
        elif kind in MAPS:
            material.folder = self["texture_map_path"].path()
        elif kind == MEASURED:
            material.latent = self["measured_brdf_npy_path"].path()
        else:
            raise self["material_type"].wrong(" or ".join((*NUMBERS, *MAPS, MEASURED)))
        material.kind, material.has_height = kind, self["use_heightmap"].flag() and kind in MAPS
        material.emission = self.emission()
        material.is_smooth = self["smooth_shading"].flag(True)
        if self["rand_tri_diffuse_seed"].value is not None:
            material.diffuse_seed = int(self["rand_tri_diffuse_seed"].numbers(1))
        return material

    def emission(self) -> tuple[float, float, float]:
        if self["emissive"].value is None:
            return 0.0, 0.0, 0.0
        emission = tuple(self["emissive"].numbers(3))
        if min(emission) < 0:
            raise self["emissive"].wrong("3 numbers that are not negative")
        return emission

    def camera(self) -> FrameCamera:
        camera = FrameCamera(*(tuple(self[name].numbers(3)) for name in ("position", "look_at", "up")),
                            self["fov"].numbers(1))
        if not 0 < camera.fov < 180:
            raise self["fov"].wrong("degrees between 0 and 180")
        return camera

    def environment(self) -> FrameEnvironment:
        return FrameEnvironment(self["env_map_path"].path(), tuple(self[f"rotation_{axis}"].numbers(1, 0.0)
                                                                   for axis in "xyz"), self["strength"].numbers(1, 1.0))

    def volume(self) -> FrameVolume:
        return FrameVolume(self["vdb_path"].path(), *self["transform"].transform(),
                           tuple(self["scattering_scale"].numbers(3)), tuple(self["absorption_scale"].numbers(3)),
                           self["transpose_written"].flag(True), int(self["seed"].numbers(1, 0)))

    def transform(self) -> tuple[tuple[float, ...], ...]:
        """Translation, rotation and scale."""
        return tuple(tuple(self[f"{what}_{axis}"].numbers(1, default) for axis in "xyz")
                     for what, default in (("translation", 0.0), ("rotation", 0.0), ("scale", 1.0)))


_IDENTITY = ((0.0,) * 3, (0.0,) * 3, (1.0,) * 3)
