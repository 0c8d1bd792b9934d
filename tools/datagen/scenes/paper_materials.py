# SPDX-License-Identifier: GPL-3.0-or-later
"""The five classes of materials of the paper profile (paper, "Training Data"; docs/scene-input.md 3.2).

(a) diffuse and specular, which together reflect 0.9 to 1; (b) metallic and rough; (c, d) both with maps; (e)
transparent, for closed meshes alone. Their roughness is log-uniform, their colours uniform.
"""
from __future__ import annotations

import bpy
import numpy as np

from .materials import CLASSES, build_material, new_material, set_inputs

CHANCES = {"object": (2 / 9, 2 / 9, 1 / 9, 1 / 9, 3 / 9), "room": (1 / 3, 1 / 3, 1 / 6, 1 / 6, 0.0)}
REFLECTED = 0.9, 1.0  # albedo of diffuse and specular together
IOR = 1.0, 2.5


def build_paper_material(rng: np.random.Generator, use: str, *, closed: bool = True) -> bpy.types.Material:
    """A random material for `use` "object" or "room"."""
    chances = np.array(CHANCES[use]) * [1, 1, 1, 1, closed]
    kind = str(rng.choice(CLASSES, p=chances / chances.sum()))
    if kind == "dielectric":
        return diffuse_and_specular(rng)
    rough = {"Roughness": 10.0 ** rng.uniform(-2.0, 0.0), "IOR": 1.5, "Specular IOR Level": 1.0}
    if kind.startswith("textured"):
        material = build_material(rng, "full", use, kind)
        set_inputs(material, rough)
        return material
    material = new_material(kind, rough | {"Base Color": rng.uniform(size=3), "Metallic": rng.uniform()})
    if kind == "transparent":
        set_inputs(material, {"Transmission Weight": rng.uniform() ** 0.7, "IOR": rng.uniform(*IOR)})
    return material


def diffuse_and_specular(rng: np.random.Generator) -> bpy.types.Material:
    """The sum of a Diffuse and a Glossy BSDF."""
    material = new_material("dielectric", {})
    tree, share = material.node_tree, rng.uniform(size=3)
    albedo, roughness = rng.uniform(*REFLECTED), 10.0 ** rng.uniform(-2.0, 0.0)
    both = tree.nodes.new("ShaderNodeAddShader")
    for i, (kind, color) in enumerate((("Diffuse", albedo * share), ("Glossy", albedo * (1 - share)))):
        lobe = tree.nodes.new(f"ShaderNodeBsdf{kind}")
        lobe.inputs["Color"].default_value = (*color, 1.0)
        tree.links.new(lobe.outputs[0], both.inputs[i])
    lobe.inputs["Roughness"].default_value = roughness
    tree.links.new(both.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    return material


def is_closed(mesh: bpy.types.Mesh) -> bool:
    """Whether two faces meet at every edge."""
    edges = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("edge_index", edges)
    return bool((np.bincount(edges, minlength=len(mesh.edges)) == 2).all())
