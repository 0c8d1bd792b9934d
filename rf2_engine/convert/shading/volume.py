# SPDX-License-Identifier: GPL-3.0-or-later
"""Volume shaders to scattering and absorption coefficients; whether a material has a surface at all."""
from __future__ import annotations

import numpy as np

from . import graph
from .evaluate import Evaluator, Points
from .image import ImageCache


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


def volume_coefficients(material, report) -> tuple[np.ndarray, np.ndarray] | None:
    """Scattering and absorption, (3,) f32 RGB each per world unit, or None when there is no Volume shader.

    For a volume object these are the factors of its density grid (spec/scene-input.md 5.6).
    """
    output = _volume_output(material)
    if output is None:
        return None
    evaluator = Evaluator(Points(), ImageCache(report), report, material.name)
    coefficients = _medium(evaluator, graph.find_input(output, "Volume"), ())
    scattering, absorption = (report.finite(material.name, "its volume", np.float32(c)) for c in coefficients)
    return np.maximum(scattering, 0), np.maximum(absorption, 0)


def _volume_output(material):
    """The Material Output when a shader reaches its Volume input, else None."""
    tree = material.node_tree if material is not None and material.use_nodes else None
    output = graph.output_node(tree)
    if output is None or graph.source(graph.find_input(output, "Volume"))[1] is None:
        return None
    return output


def _medium(evaluator, socket, frames):
    none = np.zeros(3, np.float32), np.zeros(3, np.float32)
    _, output, frames = graph.source(socket, frames)
    if output is None:
        return none
    node = output.node
    if node.bl_idname in ("ShaderNodeMixShader", "ShaderNodeAddShader"):
        first, second = (_medium(evaluator, s, frames) for s in node.inputs[-2:])
        a, b = 1.0, 1.0
        if node.bl_idname == "ShaderNodeMixShader":
            b = np.clip(evaluator.value(node.inputs[0], frames), 0, 1)
            a = 1 - b
        return tuple(a * x + b * y for x, y in zip(first, second))
    if node.bl_idname not in MEDIA:
        evaluator.approximated(node, f"{node.bl_label} is left out of the volume")
        return none
    if np.any(np.abs(evaluator.named(node, frames, "Anisotropy", default=0.0)) > 0):
        evaluator.approximated(node, "anisotropic scattering is shown as isotropic")
    return MEDIA[node.bl_idname](evaluator, node, frames)


def _principled_volume(evaluator, node, frames):
    color, density, absorption = (evaluator.named(node, frames, n) for n in ("Color", "Density", "Absorption Color"))
    glow = evaluator.named(node, frames, "Emission Strength"), evaluator.named(node, frames, "Blackbody Intensity")
    if any(np.any(g > 0) for g in glow):
        evaluator.approximated(node, "emission of a volume is left out")
    return density * color, density * np.maximum(1 - color, 0) * np.maximum(1 - np.sqrt(absorption), 0)


def _scatter(evaluator, node, frames):
    return evaluator.named(node, frames, "Density") * evaluator.named(node, frames, "Color"), np.zeros(3, np.float32)


def _absorption(evaluator, node, frames):
    tint = np.maximum(1 - evaluator.named(node, frames, "Color"), 0)
    return np.zeros(3, np.float32), evaluator.named(node, frames, "Density") * tint


def _coefficients(evaluator, node, frames):
    if np.any(evaluator.named(node, frames, "Emission Coefficients") > 0):
        evaluator.approximated(node, "emission of a volume is left out")
    return tuple(evaluator.named(node, frames, n) for n in ("Scatter Coefficients", "Absorption Coefficients"))


MEDIA = {
    "ShaderNodeVolumePrincipled": _principled_volume, "ShaderNodeVolumeScatter": _scatter,
    "ShaderNodeVolumeAbsorption": _absorption, "ShaderNodeVolumeCoefficients": _coefficients,
}
