# SPDX-License-Identifier: GPL-3.0-or-later
"""Shader nodes to closures: the parameters of each BSDF node, and what is lost (docs/scene-input.md 3.3)."""
from __future__ import annotations

import numpy as np

from ....model.material import fibre
from ....model.material.sheen import mean_albedo
from ....model.pictures import LUMINANCE
from ....model.scene import COAT
from ..data.arrays import mix_values
from . import layers
from .closure import (
    BLACK,
    ONE,
    TINY,
    WHITE,
    ZERO,
    Closure,
    guess,
    joined,
    lobe,
    scattered_once,
    window,
    with_sheen,
)
from .node_call import NodeCall
from .normal_map import tangent_normal


def closure_at(n: NodeCall, key) -> Closure:
    """Closure that a shader brings to an input of `n`; nothing linked is no closure at all."""
    shader = n.source(key)
    if shader is None:
        return Closure()
    function = SHADERS.get(shader.kind, unknown)
    n.evaluator.has_shader |= function not in (mix, add)
    return n.evaluator.evaluate_once(shader, function, Closure())


def unknown(n: NodeCall):
    n.simplified(f"{n.node.bl_label} is shown as Diffuse")
    return lobe(n.get(("Color", "Base Color"), (0.8, 0.8, 0.8)))


def mix(n: NodeCall):
    factor = np.clip(n[0], 0, 1)
    return _sum(n, closure_at(n, 1) * (1 - factor), closure_at(n, 2) * factor)


def add(n: NodeCall):
    return _sum(n, closure_at(n, 0), closure_at(n, 1))


def _sum(n: NodeCall, first: Closure, second: Closure) -> Closure:
    """The sum of two closures; what of it one BSDF cannot show is reported."""
    if not n.evaluator.keeps_lobes and np.any(first.color.any(axis=-1) & second.color.any(axis=-1)):
        n.simplified("two shaders are replaced by one in between")
    return first + second


APPROXIMATED = {  # input of Principled BSDF: what becomes of it when it is not 0
    "Coat Weight": "in mirrors and bounced light coat is a stronger, smoother reflection of the surface",
    "Sheen Weight": "in mirrors and bounced light sheen is added to the base color",
    "Subsurface Weight": "subsurface scattering is shown as diffuse",
    "Anisotropic": "anisotropy is ignored",
    "Thin Film Thickness": "thin film changes the strength of reflections, not their color",
    "Diffuse Roughness": "diffuse roughness is ignored",
}


def principled(n: NodeCall):
    for name, message in APPROXIMATED.items():
        if np.any(n.get(name) != 0):
            n.simplified(message)
    level, ior, alpha = n.get("Specular IOR Level", 0.5), n.get("IOR", 1.5), np.clip(n.get("Alpha", 1), 0, 1)
    transmission, metallic = np.clip(n.get("Transmission Weight"), 0, 1), np.clip(n.get("Metallic"), 0, 1)
    tint = n.get("Specular Tint", WHITE)
    if np.any(level * np.abs(tint - 1) > 0.01):
        n.simplified("specular tint is shown as grey")
        level = level * mix_values(tint @ LUMINANCE[:, None], ONE, metallic)
    color, roughness, coat = n.get("Base Color"), n.get("Roughness"), np.clip(n.get("Coat Weight"), 0, 1)
    clear_coat = np.zeros(len(COAT), np.float32)
    within = np.maximum(np.maximum(metallic, transmission), np.clip(n.get("Subsurface Weight"), 0, 1))
    color = mix_values(color, np.minimum(color, 1), within)  # the diffuse lobe alone may reflect more than arrives
    if np.any(coat > 0):
        color = color * mix_values(WHITE, n.get("Coat Tint", WHITE), coat)
        if n.source("Coat Normal"):
            n.simplified("its coat uses the normal of the surface")
        weight, f0 = coat, layers.normal_reflectance(n.get("Coat IOR", 1.5))
        coat = weight * f0
        gloss = metallic + transmission + 2 * level * layers.normal_reflectance(ior)
        share = coat / (gloss + coat).clip(TINY)
        clear_coat = joined(weight, coat, weight * n.get("Coat Roughness"), weight * share)
        roughness = mix_values(roughness, n.get("Coat Roughness"), share)
    if np.any(sheen := np.clip(n.get("Sheen Weight"), 0, 1) * n.get("Sheen Tint", WHITE)):
        color = layers.under_sheen(color, sheen, n.get("Sheen Roughness"))
    film = n.get("Thin Film Thickness"), np.maximum(n.get("Thin Film IOR", 1.33), 1)
    ior = mix_values(layers.effective_ior(ior, level, coat, film), ior, transmission)
    wall = np.clip(n.get("Thin Wall"), 0, 1)
    surface = lobe(color, metallic, roughness, ior, transmission * (1 - wall), tangent_normal(n))
    surface = scattered_once(surface, n.node)
    surface = with_sheen(surface, sheen, n.get("Sheen Roughness"))
    surface.coat = clear_coat
    matte = np.clip(n.get("Diffuse Roughness"), 0, 1) * (1 - metallic) * (1 - transmission)
    surface = guess(surface, np.maximum(np.abs(n.get("Anisotropic")).clip(0, 1), matte))
    if np.any(wall * transmission > 0):
        n.simplified("a thin wall lets light straight through, without blur and reflection")
        thin = wall * transmission * (1 - metallic)
        surface = surface * (1 - thin) + window(np.sqrt(np.clip(color, 0, 1))) * thin
    surface.emission = n.get("Emission Color", WHITE) * n.get("Emission Strength")
    if np.all(alpha >= 1):
        return surface
    n.simplified("alpha below 1 is shown as transmission without refraction")
    return surface * alpha + window(WHITE) * (1 - alpha)


def diffuse(n: NodeCall):
    surface = lobe(n["Color"], normal=tangent_normal(n))
    if n.kind == "ShaderNodeBsdfDiffuse" and np.any(n["Roughness"] > 0):
        n.simplified("diffuse roughness is ignored")
        surface = guess(surface, np.clip(n["Roughness"], 0, 1))
    return surface


def scattering(n: NodeCall):
    n.simplified(f"{n.node.bl_label} is shown as Diffuse")
    return guess(diffuse(n))


def subsurface(n: NodeCall):
    n.simplified(f"{n.node.bl_label} is shown as Diffuse")
    closure = diffuse(n)
    closure.color = np.minimum(closure.color, 1)
    return closure


def translucent(n: NodeCall):
    n.simplified(f"in mirrors and behind glass {n.node.bl_label} is shown as Diffuse")
    closure = diffuse(n)
    closure.translucent = closure.color
    return closure


def principled_hair(n: NodeCall):
    """What a fibre sends back and through, each as if to all directions."""
    n.simplified(f"{n.node.bl_label} is shown as Diffuse and Translucent")
    radial = n.get("Radial Roughness", 0.3)
    if n.node.parametrization == "ABSORPTION":
        absorption = np.maximum(n["Absorption Coefficient"], 0)
    elif n.node.parametrization == "MELANIN":
        melanin = n["Melanin"] * (1 + n.get("Random Color") * (2 * n.get("Random", 0.5) - 1))
        absorption = (fibre.absorption_of_melanin(melanin, n["Melanin Redness"])
                      + fibre.absorption_of_color(n["Tint"], radial))
    else:
        absorption = fibre.absorption_of_color(n["Color"], radial)
    back, through = fibre.albedo(absorption, n["IOR"])
    closure = lobe(back + through)
    closure.fibre, closure.translucent = closure.lobe, np.minimum(through, closure.color)
    return closure


def sheen(n: NodeCall):
    n.simplified(f"in mirrors and bounced light {n.node.bl_label} is shown as Diffuse")
    closure = lobe(n["Color"] * mean_albedo(n["Roughness"]), normal=tangent_normal(n))
    closure = with_sheen(closure, n["Color"], n["Roughness"])
    return guess(closure) if n.node.distribution == "ASHIKHMIN" else closure


def toon(n: NodeCall):
    if n.node.component == "DIFFUSE":
        return scattering(n)
    n.simplified(f"{n.node.bl_label} is shown as Glossy")
    return guess(lobe(n["Color"], ONE, n["Size"], normal=tangent_normal(n)))


def _report_film(n: NodeCall) -> None:
    if np.any(n.get("Thin Film Thickness") > 0):
        n.simplified("thin film is ignored")


def glossy(n: NodeCall):
    if n.kind == "ShaderNodeBsdfMetallic" and n.node.fresnel_type == "PHYSICAL_CONDUCTOR":
        ior, k = n["IOR"], n["Extinction"]
        color = ((ior - 1) ** 2 + k * k) / ((ior + 1) ** 2 + k * k)
    else:
        color = n["Base Color", "Color"]
        if np.any(np.abs(n.get("Edge Tint", WHITE) - 1) > 0.01):
            n.simplified("its Edge Tint is ignored")
    if np.any(n.get("Anisotropy") != 0):
        n.simplified("anisotropy is ignored")
    _report_film(n)
    surface = scattered_once(lobe(color, ONE, n["Roughness"], normal=tangent_normal(n)), n.node)
    return guess(surface, np.abs(n.get("Anisotropy")).clip(0, 1))


def glass(n: NodeCall):
    """Glass tints by its colour at each interface, Principled by the root of its base colour: the colour is squared."""
    if n.kind == "ShaderNodeBsdfRefraction":
        n.simplified("refraction without reflection is shown as glass")
    _report_film(n)
    surface = lobe(n["Color"] ** 2, ZERO, n["Roughness"], n["IOR"], ONE, tangent_normal(n))
    return guess(surface) if n.kind == "ShaderNodeBsdfRefraction" else surface


def portal(n: NodeCall):
    n.simplified(f"{n.node.bl_label} is shown as Transparent: it does not show what is at another place")
    return window(n["Color"])


def transparent(n: NodeCall):
    n.simplified("transparency is shown as transmission without refraction")
    return window(n["Color"])


def eevee_only(n: NodeCall):
    n.simplified(f"{n.node.bl_label} is not supported by Cycles, which shows it black: use a Principled BSDF")
    return lobe(BLACK)


def emission(n: NodeCall):
    return Closure(emission=n["Color"] * n["Strength"])


def holdout(n: NodeCall):
    """Black, as Cycles shows it to all rays but those of the camera, for which it is a hole."""
    closure = lobe(BLACK)
    closure.holdout = ONE
    return closure


SHADERS = {
    "ShaderNodeMixShader": mix, "ShaderNodeAddShader": add,
    "ShaderNodeBsdfPrincipled": principled, "ShaderNodeBsdfDiffuse": diffuse, "ShaderNodeBsdfTranslucent": translucent,
    "ShaderNodeSubsurfaceScattering": subsurface, "ShaderNodeBsdfSheen": sheen, "ShaderNodeBsdfToon": toon,
    "ShaderNodeBsdfHair": scattering, "ShaderNodeBsdfHairPrincipled": principled_hair,
    "ShaderNodeBsdfRayPortal": portal,
    "ShaderNodeBsdfVelvet": scattering, "ShaderNodeBsdfGlossy": glossy, "ShaderNodeBsdfAnisotropic": glossy,
    "ShaderNodeBsdfMetallic": glossy, "ShaderNodeBsdfGlass": glass, "ShaderNodeBsdfRefraction": glass,
    "ShaderNodeBsdfTransparent": transparent, "ShaderNodeEeveeSpecular": eevee_only,
    "ShaderNodeEmission": emission, "ShaderNodeBackground": emission, "ShaderNodeHoldout": holdout,
}
