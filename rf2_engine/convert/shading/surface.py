# SPDX-License-Identifier: GPL-3.0-or-later
"""Shader nodes to closures: which parameters each BSDF node means, and what of it is lost (docs/scene-input.md 3.3)."""
from __future__ import annotations

import numpy as np

from .closure import BLACK, ONE, WHITE, ZERO, Closure, effective_ior, lobe, window
from .node_call import NodeCall
from .normal_map import tangent_normal


def closure_at(n: NodeCall, key) -> Closure:
    """Closure that a shader brings to an input of `n`; nothing linked is no closure at all."""
    shader = n.source(key)
    return Closure() if shader is None else n.evaluator.remembered(shader, SHADERS.get(shader.kind, unknown), Closure())


def unknown(n: NodeCall):
    n.approximated(f"{n.node.bl_label} is shown as Diffuse")
    return lobe(n.get(("Color", "Base Color"), (0.8, 0.8, 0.8)))


def mix(n: NodeCall):
    factor = np.clip(n[0], 0, 1)
    return _folded(n, closure_at(n, 1) * (1 - factor), closure_at(n, 2) * factor)


def add(n: NodeCall):
    return _folded(n, closure_at(n, 0), closure_at(n, 1))


def _folded(n: NodeCall, first: Closure, second: Closure) -> Closure:
    """The sum of two closures; what of it one BSDF cannot show is reported."""
    if np.any((first.color.any(axis=-1)) & second.color.any(axis=-1)):
        n.approximated("two BSDFs are folded into one that lies between them")
    return first + second


UNSUPPORTED = {  # input of Principled BSDF: what is lost when it is not 0
    "Coat Weight": "coat is left out", "Sheen Weight": "sheen is left out", "Anisotropic": "anisotropy is left out",
    "Subsurface Weight": "subsurface scattering is shown as diffuse", "Thin Film Thickness": "thin film is left out",
    "Diffuse Roughness": "diffuse roughness is left out",
}


def principled(n: NodeCall):
    for name, message in UNSUPPORTED.items():
        if np.any(n.get(name) > 0):
            n.approximated(message)
    level, ior, alpha = n.get("Specular IOR Level", 0.5), n.get("IOR", 1.5), np.clip(n.get("Alpha", 1), 0, 1)
    transmission = np.clip(n.get("Transmission Weight"), 0, 1)
    if np.any(level * np.abs(n.get("Specular Tint", WHITE) - 1) > 0.01):
        n.approximated("specular tint is shown as white")
    ior = (1 - transmission) * effective_ior(ior, level) + transmission * ior
    surface = lobe(n.get("Base Color"), np.clip(n.get("Metallic"), 0, 1), n.get("Roughness"), ior, transmission,
                   tangent_normal(n))
    surface.emission = n.get("Emission Color", WHITE) * n.get("Emission Strength")
    if np.all(alpha >= 1):
        return surface
    n.approximated("alpha below 1 is shown as transmission without refraction")
    return surface * alpha + window(WHITE) * (1 - alpha)


def diffuse(n: NodeCall):
    if n.kind == "ShaderNodeBsdfDiffuse" and np.any(n["Roughness"] > 0):
        n.approximated("diffuse roughness is left out")
    return lobe(n["Color"], normal=tangent_normal(n))


def scattering(n: NodeCall):
    n.approximated(f"{n.node.bl_label} is shown as Diffuse")
    return diffuse(n)


def glossy(n: NodeCall):
    if n.kind == "ShaderNodeBsdfMetallic" and n.node.fresnel_type == "PHYSICAL_CONDUCTOR":
        ior, k = n["IOR"], n["Extinction"]
        color = ((ior - 1) ** 2 + k * k) / ((ior + 1) ** 2 + k * k)
    else:
        color = n["Base Color", "Color"]
    if np.any(n.get("Anisotropy") != 0):
        n.approximated("anisotropy is left out")
    return lobe(color, ONE, n["Roughness"], normal=tangent_normal(n))


def glass(n: NodeCall):
    """Glass tints by its colour at each interface, Principled by the root of its base colour: the colour is squared."""
    if n.kind == "ShaderNodeBsdfRefraction":
        n.approximated("refraction without reflection is shown as glass")
    return lobe(n["Color"] ** 2, ZERO, n["Roughness"], n["IOR"], ONE, tangent_normal(n))


def transparent(n: NodeCall):
    n.approximated("transparency is shown as transmission without refraction")
    return window(n["Color"])


def specular_workflow(n: NodeCall):
    """Eevee's Specular BSDF: diffuse plus a mirror lobe of its own colour."""
    normal = tangent_normal(n)
    surface = lobe(n["Base Color"], normal=normal) + lobe(n["Specular"], ONE, n["Roughness"], normal=normal)
    surface.emission = n.get("Emissive Color", BLACK)
    return surface


def emission(n: NodeCall):
    return Closure(emission=n["Color"] * n["Strength"])


def holdout(n: NodeCall):
    n.approximated("holdout is shown as black")
    return lobe(BLACK)


SHADERS = {
    "ShaderNodeMixShader": mix, "ShaderNodeAddShader": add,
    "ShaderNodeBsdfPrincipled": principled, "ShaderNodeBsdfDiffuse": diffuse, "ShaderNodeBsdfTranslucent": scattering,
    "ShaderNodeSubsurfaceScattering": scattering, "ShaderNodeBsdfSheen": scattering, "ShaderNodeBsdfToon": scattering,
    "ShaderNodeBsdfVelvet": scattering, "ShaderNodeBsdfGlossy": glossy, "ShaderNodeBsdfAnisotropic": glossy,
    "ShaderNodeBsdfMetallic": glossy, "ShaderNodeBsdfGlass": glass, "ShaderNodeBsdfRefraction": glass,
    "ShaderNodeBsdfTransparent": transparent, "ShaderNodeEeveeSpecular": specular_workflow,
    "ShaderNodeEmission": emission, "ShaderNodeBackground": emission, "ShaderNodeHoldout": holdout,
}
