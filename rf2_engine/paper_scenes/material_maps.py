# SPDX-License-Identifier: GPL-3.0-or-later
"""Describe materials as the research code does: by numbers, or by maps of 256 x 256 texels over the UV square."""
from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ...model.published.prepared_frame import HEIGHT, MEASURED, FrameMaterial
from ...model.scene import TILE_SIZE
from ..convert.data.blocks import Material
from ..convert.data.copied import Instance
from ..convert.data.mesh import TriangleMesh
from ..convert.data.report import Report
from ..convert.shading.material import evaluate_material
from ..convert.shading.material_tiles import EMITTER_RADIANCE
from ..convert.shading.normal_map import UP
from ..convert.shading.points import surface_points
from ..convert.shading.tile_arrays import mean_over_triangle
from ..convert.shading.two_lobes import two_lobes

PAPER_IOR = 1.5  # of dielectrics, at Specular IOR Level 1
SQUARES = 8      # tiles along each side of a map
SAMPLES = 64     # triangles whose mean stands for a material that UVs do not describe
BARE = FrameMaterial("homo_diffuse_specular", {"diffuse": [0.4] * 3, "specular": [0.0] * 3, "roughness": 1.0})
LAMP = {"diffuse": [1.0] * 3, "specular": [0.0] * 3, "roughness": 1.0}
TYPES = {"homo_diffuse_specular": "svbrdf_diffuse_specular", "homo_metallic_roughness": "svbrdf_metallic_roughness"}
MAP_NAMES = {"base_color": "basecolor"}  # where a map is named otherwise than the number


@dataclass
class DescribedMaterial:
    """A material whose files have no paths yet."""

    material: FrameMaterial
    maps: dict[str, np.ndarray] = field(default_factory=dict)  # by name, (256, 256, 3) u8, row 0 on top
    latent: np.ndarray | None = None                           # (9,) f32


def describe(material: Material | None, mesh: TriangleMesh, instance: Instance, report: Report) -> DescribedMaterial:
    """Describe the material of triangles of one slot in an instance. The report names what is lost."""
    if material is None:
        return DescribedMaterial(BARE)
    values = _Values(material, surface_points(_sample_triangles(mesh), instance), report)
    emission = mean_over_triangle(values["emission"]).reshape(-1, 3)
    if emission.max() >= EMITTER_RADIANCE:
        if np.ptp(emission, axis=0).max() > 0.01 * emission.max():
            report.approximated(material.name, "all of it shines with the mean of its light")
        radiance = tuple(emission.mean(axis=0).tolist())
        return DescribedMaterial(FrameMaterial("homo_diffuse_specular", LAMP, emission=radiance))
    if emission.any():
        report.approximated(material.name, "its weak glow is left out: a surface that shines reflects nothing in the "
                                           "research code")
    if material.latent:
        return DescribedMaterial(FrameMaterial(MEASURED), latent=np.float32(material.latent))
    if not values.varies:
        return DescribedMaterial(_homogeneous(values.numbers()))
    sheet = _Values(material, surface_points(_uv_sheet(mesh), instance), Report())
    moved = _Values(material, surface_points(_move_sheet(_uv_sheet(mesh)), instance), Report())
    if not mesh.uv or not sheet.equals(moved):
        report.approximated(material.name, "it varies by more than UVs: its mean is used; bake it to images first")
        return DescribedMaterial(_homogeneous(values.numbers()))
    if not np.array_equal(sheet["normal"], moved["normal"]):
        report.approximated(material.name, "its bumps are left out: bake them to a normal map first")
        sheet["normal"] = UP
    return _textured(material, sheet, report)


class _Values(dict):
    """Properties of a surface by name: (c,) where they are the same at all points, else (m, 32, 32, c)."""

    def __init__(self, material: Material, points, report: Report):
        lobes = two_lobes(material, points)
        surface, height, *_ = evaluate_material(material, points, report, keeps_lobes=True)
        super().__init__({key: getattr(surface, key) for key in (
            "base_color", "metallic", "roughness", "ior", "transmission", "normal", "emission")}, height=height)
        self["base_color"] = np.minimum(self["base_color"], 1)  # no mapper was trained with more
        self.update(lobes or {})  # two lobes that the research code has as well

    @property
    def varies(self) -> bool:
        return any(value.ndim > 1 for key, value in self.items() if key != "emission")

    def equals(self, other: _Values) -> bool:
        return all(np.allclose(value, other[key], atol=1e-4) for key, value in self.items() if key != "normal")

    def numbers(self) -> dict[str, list[float] | float]:
        means = {key: mean_over_triangle(value).reshape(-1, value.shape[-1]).mean(axis=0)
                 for key, value in self.items()}
        return {key: mean.tolist() if len(mean) > 1 else float(mean[0]) for key, mean in means.items()}


def _homogeneous(numbers: dict) -> FrameMaterial:
    kind, names = _choose_type(numbers)
    if kind == "homo_diffuse_specular" and "diffuse" not in numbers:
        return FrameMaterial(kind, {"diffuse": numbers["base_color"], "specular": [0.0] * 3, "roughness": 1.0})
    numbers = {"transmission_weight": numbers["transmission"], **numbers}
    return FrameMaterial(kind, {name: numbers[name] for name in names})


def _choose_type(numbers: dict) -> tuple[str, tuple[str, ...]]:
    """The type of material with these numbers (docs/scene-input.md 3.2, 3.3), and the names of its properties."""
    if "diffuse" in numbers or not (numbers["transmission"] or numbers["metallic"]) and numbers["ior"] == 1:
        return "homo_diffuse_specular", ("diffuse", "specular", "roughness")
    if numbers["transmission"] or (numbers["metallic"] < 1 and abs(numbers["ior"] - PAPER_IOR) > 1e-4):
        return "homo_metallic_roughness_transmission", ("base_color", "metallic", "roughness", "transmission_weight",
                                                        "ior")
    return "homo_metallic_roughness", ("base_color", "metallic", "roughness")


def _textured(material: Material, sheet: _Values, report: Report) -> DescribedMaterial:
    numbers = sheet.numbers()
    kind, names = _choose_type(numbers)
    if kind not in TYPES and numbers["transmission"] > 0.5:
        report.approximated(material.name, "textures of glass have no place in the file: their mean is used")
        return DescribedMaterial(_homogeneous(numbers))
    if kind not in TYPES:
        report.approximated(material.name, f"it reflects like an IOR of {PAPER_IOR} at Specular IOR Level 1, and lets "
                                           "no light through")
        kind, names = "homo_metallic_roughness", ("base_color", "metallic", "roughness")
    elif "diffuse" not in sheet:
        sheet |= {"diffuse": sheet["base_color"], "specular": np.zeros(3)}
    maps = {MAP_NAMES.get(name, name): _draw_map(sheet[name]) for name in names}
    maps["normal"] = _draw_map((sheet["normal"] + 1) / 2)
    has_height = bool(np.any(sheet["height"]))
    if has_height:
        maps[HEIGHT] = _draw_map((sheet["height"] + 1) / 2)
    return DescribedMaterial(FrameMaterial(TYPES[kind], has_height=has_height), maps)


def _draw_map(values: np.ndarray) -> np.ndarray:
    """A map (256, 256, 3) u8 of values (c,) or (64, 32, 32, c) from 0 to 1."""
    tiles = np.broadcast_to(values, (SQUARES * SQUARES, TILE_SIZE, TILE_SIZE, 3))
    side = SQUARES * TILE_SIZE
    image = tiles.reshape(SQUARES, SQUARES, TILE_SIZE, TILE_SIZE, 3).transpose(0, 2, 1, 3, 4).reshape(side, side, 3)
    return (np.clip(image, 0, 1) * 255 + 0.5).astype(np.uint8)


def _sample_triangles(mesh: TriangleMesh) -> TriangleMesh:
    return mesh if len(mesh) <= SAMPLES else mesh.take(np.linspace(0, len(mesh) - 1, SAMPLES).astype(int))


def _uv_sheet(mesh: TriangleMesh) -> TriangleMesh:
    """Triangles whose tiles, continued beyond their long side, are the squares of a map, row by row."""
    row, column = np.divmod(np.arange(SQUARES * SQUARES), SQUARES)
    corners = np.stack([column, SQUARES - row], axis=-1)[:, None] + np.array([(1, 0), (0, -1), (0, 0)])
    uv = (corners / SQUARES).astype(np.float32)
    count = len(uv)
    return replace(
        mesh, corners=np.pad(uv, ((0, 0), (0, 0), (0, 1))), normals=np.tile(np.float32((0, 0, 1)), (count, 3, 1)),
        uv=dict.fromkeys(mesh.uv, uv), slot=np.zeros(count, np.int32),
        attributes={name: np.ones((count, 3, layer.shape[-1]), np.float32) for name, layer in mesh.attributes.items()})


def _move_sheet(sheet: TriangleMesh) -> TriangleMesh:
    """The same UVs at other positions, with other normals and attributes."""
    return replace(sheet, corners=np.float32(sheet.corners[..., [1, 2, 0]] * (1.5, 2, 3) + (0.3, -0.2, 0.7)),
                   normals=sheet.normals[..., [2, 0, 1]],
                   attributes={name: layer * 0.4 for name, layer in sheet.attributes.items()})
