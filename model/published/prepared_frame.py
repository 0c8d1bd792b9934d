# SPDX-License-Identifier: GPL-3.0-or-later
"""A prepared frame of the research code: scene_config.json beside meshes and maps (docs/scene-input.md 8.4)."""
from __future__ import annotations

import json
import sys
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath, PureWindowsPath

from ..errors import SceneError
from ..weights.files import is_lfs_pointer

CONFIG, MESHES = "scene_config.json", "split"
VERSION = "2.0.0"
# By material type: where its numbers stand, and how many there are of each.
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


def read_frame(folder: Path) -> PreparedFrame:
    """The description of a frame; whether what it names is there is left to `missing`.

    Raises SceneError naming the file, the entry in it, and what was expected.
    """
    file = Path(folder) / CONFIG
    try:
        content = json.loads(file.read_text(encoding="utf-8-sig"))
    except FileNotFoundError as error:
        raise SceneError(f"{folder} is no prepared frame: there is no {CONFIG} in it. Choose the folder that holds "
                         "that file") from error
    except (OSError, ValueError, RecursionError) as error:
        raise SceneError(f"{file} cannot be read ({error}): copy or export it again") from error
    return _Entry(content, str(file)).frame()


def named(frame: PreparedFrame, folder: Path) -> list[str]:
    """All files that the frame consists of, by their names in its folder."""
    wanted = [it.mesh for it in frame.objects.values()]
    for it in frame.objects.values():
        wanted += [] if it.material.latent is None else [it.material.latent]
        wanted += [map_file(folder, it.material, name).relative_to(folder).as_posix() for name in maps(it.material)]
    wanted += [frame.environment.image] if frame.environment else []
    wanted += [volume.grid for volume in frame.volumes]
    return list(dict.fromkeys(wanted))


def missing(frame: PreparedFrame, folder: Path) -> list[str]:
    """Those that are not there."""
    return [name for name in named(frame, folder) if not (Path(folder) / name).is_file()]


def pointers(frame: PreparedFrame, folder: Path) -> list[str]:
    """Those that a clone without Git LFS has in place of the files themselves. Raises OSError."""
    there = set(named(frame, folder)) - set(missing(frame, folder))
    return sorted(name for name in there if is_lfs_pointer(Path(folder) / name))


def maps(material: FrameMaterial) -> tuple[str, ...]:
    """Names of the maps that the material has."""
    return MAPS.get(material.kind, ()) + (HEIGHT,) * material.has_height


def map_file(folder: Path, material: FrameMaterial, name: str) -> Path:
    found = Path(folder) / material.folder / f"{name}.png"
    other = found.with_stem(ALSO.get(name, name))
    return other if other.is_file() and not found.is_file() else found


def write_frame(frame: PreparedFrame, folder: Path) -> None:
    """The description alone. Raises OSError as the disk does."""
    volumes = [{"vdb_path": it.grid, "transform": _transform(it.translation, it.rotation, it.scale),
                "scattering_scale": list(it.scattering), "absorption_scale": list(it.absorption), "seed": it.seed,
                "transpose_written": it.is_transposed} for it in frame.volumes]
    environment = frame.environment and {"env_map_path": frame.environment.image} | {
        f"rotation_{axis}": angle for axis, angle in zip("xyz", frame.environment.rotation)} | {
        "strength": frame.environment.strength}
    content = {
        "scene_name": frame.name, "version": VERSION,
        "objects": {key: {"mesh_path": it.mesh, "transform": _transform(), "is_background": it.is_background,
                          "is_lighting": it.is_light, "material": _material(it.material)}
                    for key, it in frame.objects.items()},
        "cameras": [{"position": list(it.position), "look_at": list(it.look_at), "up": list(it.up), "fov": it.fov}
                    for it in frame.cameras],
        "lighting": [], "env_map": environment, "volumes": volumes or None, "wall_holes": None}
    (Path(folder) / CONFIG).write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def _transform(translation=(0.0,) * 3, rotation=(0.0,) * 3, scale=(1.0,) * 3) -> dict:
    named = {"translation": translation, "rotation": rotation, "scale": scale}
    return {f"{what}_{axis}": float(value) for what, values in named.items() for axis, value in zip("xyz", values)} | {
        "normalize": False}


def _material(material: FrameMaterial) -> dict:
    numbers = {key: material.numbers if kind == material.kind else None for kind, (key, _) in NUMBERS.items()}
    return {"material_type": material.kind, "texture_map_path": material.folder, "texture_map_aug_random_seed": None,
            "use_heightmap": material.has_height, **numbers, "measured_brdf_npy_path": material.latent,
            "emissive": list(material.emission), "smooth_shading": material.is_smooth, "rand_tri_diffuse_seed": None}


class _Entry:
    """One value of the file, and where it stands there."""

    def __init__(self, value, where: str):
        self.value, self.where = value, where

    def frame(self) -> PreparedFrame:
        if self["lighting"].value:
            raise self["lighting"].wrong("an empty list: lamps are objects with is_lighting")
        environment, volumes = self["env_map"], self["volumes"]
        return PreparedFrame(
            self["scene_name"].text(default="RenderFormer Scene"),
            {key: _Entry(value, f"{self.where}: {key}").object() for key, value in self["objects"].mapping().items()},
            [it.camera() for it in self["cameras"].items()],
            None if environment.value is None else environment.environment(),
            [] if volumes.value is None else [it.volume() for it in volumes.items()])

    def object(self) -> FrameObject:
        if "transform" in self.mapping() and self["transform"].transform() != _IDENTITY:
            raise self["transform"].wrong("no transform: the meshes of a frame hold world coordinates")
        return FrameObject(self["mesh_path"].path(), self["material"].material(), self["is_background"].flag(),
                           self["is_lighting"].flag())

    def material(self) -> FrameMaterial:
        kind, found = self["material_type"].text(), FrameMaterial("")
        if kind in NUMBERS:
            key, counts = NUMBERS[kind]
            found.numbers = {name: self[key][name].numbers(count) for name, count in counts.items()}
        elif kind in MAPS:
            found.folder = self["texture_map_path"].path()
        elif kind == MEASURED:
            found.latent = self["measured_brdf_npy_path"].path()
        else:
            raise self["material_type"].wrong(" or ".join((*NUMBERS, *MAPS, MEASURED)))
        found.kind, found.has_height = kind, self["use_heightmap"].flag() and kind in MAPS
        if self["emissive"].value is not None:
            found.emission = tuple(self["emissive"].numbers(3))
            if min(found.emission) < 0:
                raise self["emissive"].wrong("3 numbers that are not negative")
        found.is_smooth = self["smooth_shading"].flag(True)
        return found

    def camera(self) -> FrameCamera:
        found = FrameCamera(*(tuple(self[name].numbers(3)) for name in ("position", "look_at", "up")),
                            self["fov"].numbers(1))
        if not 0 < found.fov < 180:
            raise self["fov"].wrong("degrees between 0 and 180")
        return found

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

    def __getitem__(self, key: str) -> _Entry:
        return _Entry(self.mapping().get(key), f"{self.where}: {key}")

    def mapping(self) -> dict:
        if not isinstance(self.value, dict):
            raise self.wrong("an object in braces")
        return self.value

    def items(self) -> list[_Entry]:
        if not isinstance(self.value, list):
            raise self.wrong("a list")
        return [_Entry(value, f"{self.where}, item {i}") for i, value in enumerate(self.value)]

    def text(self, default: str | None = None) -> str:
        if self.value is None and default is not None:
            return default
        if not isinstance(self.value, str):
            raise self.wrong("a text")
        return self.value

    def path(self) -> str:
        """A place below the frame: nothing else of the disk is read."""
        text = self.text()
        parts = PureWindowsPath(text).parts
        if not parts or PureWindowsPath(text).is_absolute() or PurePosixPath(text).is_absolute() or ".." in parts:
            raise self.wrong("a path inside the frame's folder")
        return "/".join(parts)

    def flag(self, default: bool = False) -> bool:
        if self.value is None:
            return default
        if not isinstance(self.value, bool):
            raise self.wrong("true or false")
        return self.value

    def numbers(self, count: int, default: float | None = None):
        """A number, or a list of `count` of them."""
        if self.value is None and default is not None:
            return default
        values = self.value if count > 1 else [self.value]
        if not isinstance(values, list) or len(values) != count or not all(map(_is_number, values)):
            raise self.wrong("a number" if count == 1 else f"{count} numbers")
        found = [float(value) for value in values]
        return found if count > 1 else found[0]

    def wrong(self, expected: str) -> SceneError:
        found = "nothing" if self.value is None else json.dumps(self.value)[:60]
        return SceneError(f"{self.where}: expected {expected}, found {found}")


def _is_number(value) -> bool:
    """Whether it is one that a float can hold."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


_IDENTITY = ((0.0,) * 3, (0.0,) * 3, (1.0,) * 3)
