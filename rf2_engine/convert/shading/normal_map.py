# SPDX-License-Identifier: GPL-3.0-or-later
"""The Normal input of a shader in tangent space."""
from __future__ import annotations

import numpy as np

from .node_call import NodeCall

UP = np.array([0.0, 0.0, 1.0], np.float32)


def tangent_normal(n: NodeCall) -> np.ndarray:
    """(..., 3) tangent-space normal, 2 * map - 1, that reaches the Normal input of `n` (docs/scene-input.md 4.4)."""
    source = n.source("Normal")
    if source is None:
        return UP
    if source.kind == "ShaderNodeNormalMap" and source.node.space == "TANGENT":
        return np.clip(UP + source["Strength"] * (2 * source["Color"] - 1 - UP), -1, 1)
    if source.kind == "ShaderNodeBump":
        source.approximated("bump is left out; bake it to a normal map")
        return tangent_normal(source)
    if not (source.kind == "ShaderNodeNewGeometry" and source.output.name == "Normal"):
        source.approximated("only tangent-space normal maps are evaluated, the mesh normal is used")
    return UP
