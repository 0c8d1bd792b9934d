# SPDX-License-Identifier: GPL-3.0-or-later
"""Volume shaders to scattering and absorption coefficients; whether a material has a surface at all."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..data.copied import Instance
from ..data.report import Report
from . import graph
from .evaluate import Evaluator
from .node_call import NodeCall
from .points import Points
from .spectrum import blackbody_color

NONE = np.zeros(3, np.float32)
STEFAN_BOLTZMANN = 5.670373e-14 / np.pi  # as Cycles has it, in its units


def has_surface(material) -> bool:
    """False for a material that shows only its volume: no Surface shader, or a plain Transparent BSDF."""
    output = _volume_output(material)
    if output is None:
        return True
    _, shader, frames = graph.source(graph.find_input(output, "Surface"))
    if shader is None:
        return False
    if shader.node.bl_idname != "ShaderNodeBsdfTransparent":
        return True
    color, link, _ = graph.source(shader.node.inputs["Color"], frames)
    return link is not None or min(color.default_value[:3]) < 1


def has_volume(material) -> bool:
    """Whether a shader reaches its Volume input."""
    return _volume_output(material) is not None


@dataclass
class VolumePoints(Points):
    """Points inside a medium: `inside` (..., 3) f32 in the frame of the object."""

    inside: np.ndarray | None = None
    grids: Callable[[str], np.ndarray | None] | None = None  # by name: values (..., c) at the points
    depends_on_instance: bool = False  # whether what was evaluated is that of one instance

    @property
    def position(self) -> np.ndarray:
        return self.inside

    def grid(self, name: str) -> np.ndarray:
        """0 where there is no such grid, as in Cycles."""
        values = self.grids(name) if self.grids else None
        return np.zeros(1, np.float32) if values is None else values


def volume_points(inside: np.ndarray, texture_space: np.ndarray, instance: Instance, grids: Callable | None = None,
                  ) -> VolumePoints:
    """inside: (..., 3) in the frame of the object; texture_space (2, 3) as in data/mesh.py."""
    return VolumePoints(corners=np.zeros((0, 3, 3), np.float32), texture_space=texture_space, instance=instance,
                        inside=inside.astype(np.float32), grids=grids)


def volume_coefficients(material, report: Report, points: VolumePoints | None = None,
                        ) -> tuple[np.ndarray, np.ndarray] | None:
    """Scattering and absorption, (3,) f32 RGB each per world unit, or None when there is no Volume shader.

    material: or a world. Of a shader that varies over `points` (n, ..., 3) they are as many (docs/scene-input.md 5.6).
    """
    output = _volume_output(material)
    if output is None:
        return None
    points = points or VolumePoints()
    evaluator = Evaluator(points, material.node_tree.conventions, report, material.name)
    coefficients = coefficients_at(NodeCall(evaluator, output), "Volume")
    points.depends_on_instance = evaluator.depends_on_instance or evaluator.depends_on_scale
    scattering, absorption = (report.finite(material.name, "its volume", np.float32(c)) for c in coefficients)
    return np.maximum(scattering, 0), np.maximum(absorption, 0)


def volume_emission(material, report: Report, points: VolumePoints | None = None) -> np.ndarray:
    """Radiance per world unit of length that a Volume shader sends out, (3,), or (n, ..., 3) as above."""
    output = _volume_output(material)
    if output is None:
        return NONE
    evaluator = Evaluator(points or VolumePoints(), material.node_tree.conventions, report, material.name)
    emission = np.float32(emission_at(NodeCall(evaluator, output), "Volume"))
    return np.maximum(report.finite(material.name, "its volume", emission), 0)


def find_grid_names(material) -> list[str]:
    """Names of the grids that the Volume shader of a material reads."""
    names = {}
    points = volume_points(np.zeros((1, 3)), np.float32([(0, 0, 0), (1, 1, 1)]), Instance(),
                           lambda name: names.setdefault(name))
    volume_coefficients(material, Report(), points)
    volume_emission(material, Report(), points)
    return [name for name in names if name]


def _volume_output(material):
    """The Material Output when a shader reaches its Volume input, else None."""
    output = graph.output_node(material.node_tree) if material is not None else None
    if output is None or graph.source(graph.find_input(output, "Volume"))[1] is None:
        return None
    return output


def coefficients_at(n: NodeCall, key) -> tuple[np.ndarray, np.ndarray]:
    """Scattering and absorption that a shader brings to an input of `n`; 0 when nothing is linked."""
    shader = n.source(key)
    if shader is None:
        return NONE, NONE
    return n.evaluator.evaluate_once(shader, SHADERS.get(shader.kind, unknown), (NONE, NONE))


def unknown(n: NodeCall):
    n.approximated("it is ignored in the volume")
    return NONE, NONE


def mix(n: NodeCall):
    factor, (s1, a1), (s2, a2) = np.clip(n[0], 0, 1), coefficients_at(n, 1), coefficients_at(n, 2)
    return (1 - factor) * s1 + factor * s2, (1 - factor) * a1 + factor * a2


def add(n: NodeCall):
    (s1, a1), (s2, a2) = coefficients_at(n, 0), coefficients_at(n, 1)
    return s1 + s2, a1 + a2


def principled(n: NodeCall):
    _report_losses(n)
    color, density = n["Color"], n["Density"]
    for name in ("Density Attribute", "Color Attribute"):
        grid = n.points.grids and n.points.grids(graph.find_input(n.node, name).default_value)
        if grid is not None and name.startswith("Density"):
            density = density * np.maximum(grid[..., :1], 0)
        elif grid is not None:
            color = color * np.maximum(grid[..., :3], 0)
    return density * color, density * np.maximum(1 - color, 0) * np.maximum(1 - np.sqrt(n["Absorption Color"]), 0)


def scatter(n: NodeCall):
    _report_losses(n)
    return n["Density"] * n["Color"], NONE


def absorption(n: NodeCall):
    return NONE, n["Density"] * np.maximum(1 - n["Color"], 0)


def coefficients(n: NodeCall):
    _report_losses(n)
    return n["Scatter Coefficients"], n["Absorption Coefficients"]


def emission_at(n: NodeCall, key) -> np.ndarray:
    """Emission that a shader brings to an input of `n`; 0 when nothing is linked."""
    shader = n.source(key)
    if shader is None or shader.kind not in EMISSION:
        return NONE
    return n.evaluator.evaluate_once(shader, EMISSION[shader.kind], NONE)


def mixed_emission(n: NodeCall):
    factor = np.clip(n[0], 0, 1)
    return (1 - factor) * emission_at(n, 1) + factor * emission_at(n, 2)


def added_emission(n: NodeCall):
    return emission_at(n, 0) + emission_at(n, 1)


def principled_emission(n: NodeCall):
    """Glow, and a black body's light: of its temperature to the fourth as much as Blackbody Intensity says."""
    intensity, kelvin = n["Blackbody Intensity"], n["Temperature"]
    grid = n.points.grids and n.points.grids(graph.find_input(n.node, "Temperature Attribute").default_value)
    if grid is not None:
        kelvin = kelvin * grid[..., :1]
    kelvin = np.maximum(kelvin, 0)
    strength = STEFAN_BOLTZMANN * ((1 - intensity) + intensity * kelvin ** 4) * (intensity > 0)
    return n["Emission Color"] * n["Emission Strength"] + (
        n.conventions.from_rec709(blackbody_color(kelvin)) * n["Blackbody Tint"] * strength)


def coefficient_emission(n: NodeCall):
    return n["Emission Coefficients"]


def emission(n: NodeCall):
    return n["Color"] * n["Strength"]


def no_coefficients(n: NodeCall):
    return NONE, NONE


def _report_losses(n: NodeCall) -> None:
    if np.any(np.abs(n.get("Anisotropy")) > 0):
        n.approximated("anisotropic scattering is shown as isotropic")


SHADERS = {
    "ShaderNodeMixShader": mix, "ShaderNodeAddShader": add, "ShaderNodeVolumePrincipled": principled,
    "ShaderNodeVolumeScatter": scatter, "ShaderNodeVolumeAbsorption": absorption,
    "ShaderNodeVolumeCoefficients": coefficients, "ShaderNodeEmission": no_coefficients,
}
EMISSION = {
    "ShaderNodeMixShader": mixed_emission, "ShaderNodeAddShader": added_emission, "ShaderNodeEmission": emission,
    "ShaderNodeVolumePrincipled": principled_emission, "ShaderNodeVolumeCoefficients": coefficient_emission,
}
