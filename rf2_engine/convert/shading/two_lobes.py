# SPDX-License-Identifier: GPL-3.0-or-later
"""A Diffuse and a Glossy BSDF added: what the research code calls diffuse and specular (docs/scene-input.md 3.2)."""
from __future__ import annotations

import numpy as np

from ..data.blocks import Material
from ..data.report import Report
from . import graph
from .evaluate import Evaluator
from .node_call import NodeCall
from .normal_map import tangent_normal
from .points import Points

GLOSSY = ("ShaderNodeBsdfAnisotropic", "ShaderNodeBsdfGlossy")


def two_lobes(material: Material, points: Points) -> dict[str, np.ndarray] | None:
    """"diffuse", "specular", "roughness" and "normal" of such a material; None of others.

    Values are (c,) where they are the same at all points, else (m, 32, 32, c).
    """
    output = graph.output_node(material.node_tree)
    if output is None:
        return None
    both = lobe_nodes(NodeCall(Evaluator(points, material.node_tree.conventions, Report(), material.name), output))
    if both is None:
        return None
    diffuse, glossy = both
    return {"diffuse": np.clip(diffuse["Color"], 0, 1), "specular": np.clip(glossy["Color"], 0, 1),
            "roughness": np.clip(glossy["Roughness"], 0, 1), "normal": np.asarray(tangent_normal(diffuse))}


def lobe_nodes(output: NodeCall) -> tuple[NodeCall, NodeCall] | None:
    """The Diffuse and the Glossy BSDF that the surface of a Material Output is the sum of; None of another one."""
    n = output.source("Surface")
    if n is None or n.kind != "ShaderNodeAddShader":
        return None
    both = {lobe.kind: lobe for lobe in (n.source(0), n.source(1)) if lobe is not None}
    diffuse, glossy = both.get("ShaderNodeBsdfDiffuse"), next((both[kind] for kind in GLOSSY if kind in both), None)
    return None if diffuse is None or glossy is None else (diffuse, glossy)
