# SPDX-License-Identifier: GPL-3.0-or-later
"""Shader nodes to closures: which parameters each BSDF node means, and what of it is lost (spec/scene-input.md 3.3)."""
from __future__ import annotations

import numpy as np

from . import graph
from .closure import BLACK, ONE, WHITE, ZERO, Closure, effective_ior, lobe
from .evaluate import Evaluator
from .texture import UP, tangent_normal


def evaluate_shader(evaluator: Evaluator, socket, frames=()) -> Closure:
    """Closure arriving at a shader input socket; nothing linked is no closure at all."""
    _, output, frames = graph.source(socket, frames)
    if output is None:
        return Closure()
    node = output.node
    if node.bl_idname == "ShaderNodeMixShader":
        factor = np.clip(evaluator.value(node.inputs[0], frames), 0, 1)
        first, second = (evaluate_shader(evaluator, s, frames) for s in node.inputs[1:3])
        return first * (1 - factor) + second * factor
    if node.bl_idname == "ShaderNodeAddShader":
        return evaluate_shader(evaluator, node.inputs[0], frames) + evaluate_shader(evaluator, node.inputs[1], frames)
    if node.bl_idname in SHADERS:
        return SHADERS[node.bl_idname](evaluator, node, frames)
    evaluator.approximated(node, f"{node.bl_label} is shown as Diffuse")
    return lobe(evaluator.named(node, frames, "Color", "Base Color", default=(0.8, 0.8, 0.8)))


UNSUPPORTED = {  # input of Principled BSDF: what is lost when it is not 0
    "Coat Weight": "coat is left out", "Sheen Weight": "sheen is left out", "Anisotropic": "anisotropy is left out",
    "Subsurface Weight": "subsurface scattering is shown as diffuse", "Thin Film Thickness": "thin film is left out",
}


def principled(evaluator, node, frames):
    def get(name, default=0.0):
        return evaluator.named(node, frames, name, default=default)

    for name, message in UNSUPPORTED.items():
        if np.any(get(name) > 0):
            evaluator.approximated(node, message)
    level, alpha = get("Specular IOR Level", 0.5), np.clip(get("Alpha", 1), 0, 1)
    transmission = np.clip(get("Transmission Weight"), 0, 1)
    if np.any(level * np.abs(get("Specular Tint", WHITE) - 1) > 0.01):
        evaluator.approximated(node, "specular tint is shown as white")
    ior = (1 - transmission) * effective_ior(get("IOR", 1.5), level) + transmission * get("IOR", 1.5)
    surface = lobe(get("Base Color"), np.clip(get("Metallic"), 0, 1), get("Roughness"), ior, transmission,
                   _normal(evaluator, node, frames))
    surface.emission = get("Emission Color", WHITE) * get("Emission Strength")
    if np.all(alpha >= 1):
        return surface
    evaluator.approximated(node, "alpha below 1 is shown as transmission without refraction")
    return surface * alpha + lobe(WHITE, roughness=ZERO, transmission=ONE) * (1 - alpha)


def diffuse(evaluator, node, frames):
    return lobe(evaluator.named(node, frames, "Color"), normal=_normal(evaluator, node, frames))


def scattering(evaluator, node, frames):
    evaluator.approximated(node, f"{node.bl_label} is shown as Diffuse")
    return diffuse(evaluator, node, frames)


def glossy(evaluator, node, frames):
    if node.bl_idname == "ShaderNodeBsdfMetallic" and node.fresnel_type == "PHYSICAL_CONDUCTOR":
        n, k = evaluator.named(node, frames, "IOR"), evaluator.named(node, frames, "Extinction")
        color = ((n - 1) ** 2 + k * k) / ((n + 1) ** 2 + k * k)
    else:
        color = evaluator.named(node, frames, "Base Color", "Color")
    if np.any(evaluator.named(node, frames, "Anisotropy", default=0.0) != 0):
        evaluator.approximated(node, "anisotropy is left out")
    return lobe(color, ONE, evaluator.named(node, frames, "Roughness"), normal=_normal(evaluator, node, frames))


def glass(evaluator, node, frames):
    """Glass tints by its colour at each interface, Principled by the root of its base colour: the colour is squared."""
    if node.bl_idname == "ShaderNodeBsdfRefraction":
        evaluator.approximated(node, "refraction without reflection is shown as glass")
    return lobe(evaluator.named(node, frames, "Color") ** 2, ZERO, evaluator.named(node, frames, "Roughness"),
                evaluator.named(node, frames, "IOR"), ONE, _normal(evaluator, node, frames))


def transparent(evaluator, node, frames):
    evaluator.approximated(node, "transparency is shown as transmission without refraction")
    return lobe(evaluator.named(node, frames, "Color") ** 2, roughness=ZERO, transmission=ONE)


def specular_workflow(evaluator, node, frames):
    """Eevee's Specular BSDF: diffuse plus a mirror lobe of its own colour."""
    normal, rough = _normal(evaluator, node, frames), evaluator.named(node, frames, "Roughness")
    base, mirror = (evaluator.named(node, frames, name) for name in ("Base Color", "Specular"))
    surface = lobe(base, normal=normal) + lobe(mirror, ONE, rough, normal=normal)
    surface.emission = evaluator.named(node, frames, "Emissive Color", default=BLACK)
    return surface


def emission(evaluator, node, frames):
    return Closure(emission=evaluator.named(node, frames, "Color") * evaluator.named(node, frames, "Strength"))


def holdout(evaluator, node, frames):
    evaluator.approximated(node, "holdout is shown as black")
    return lobe(BLACK)


def _normal(evaluator, node, frames):
    socket = graph.find_input(node, "Normal")
    return UP if socket is None else tangent_normal(evaluator, socket, frames)


SHADERS = {
    "ShaderNodeBsdfPrincipled": principled, "ShaderNodeBsdfDiffuse": diffuse, "ShaderNodeBsdfTranslucent": scattering,
    "ShaderNodeSubsurfaceScattering": scattering, "ShaderNodeBsdfSheen": scattering, "ShaderNodeBsdfToon": scattering,
    "ShaderNodeBsdfVelvet": scattering, "ShaderNodeBsdfGlossy": glossy, "ShaderNodeBsdfAnisotropic": glossy,
    "ShaderNodeBsdfMetallic": glossy, "ShaderNodeBsdfGlass": glass, "ShaderNodeBsdfRefraction": glass,
    "ShaderNodeBsdfTransparent": transparent, "ShaderNodeEeveeSpecular": specular_workflow,
    "ShaderNodeEmission": emission, "ShaderNodeBackground": emission, "ShaderNodeHoldout": holdout,
}
