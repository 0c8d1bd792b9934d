# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluate the surface of a material at points: the parameters of one BSDF, and a height."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..data.blocks import Material
from ..data.copied import Instance
from ..data.mesh import TriangleMesh, face_normals
from ..data.report import Report
from . import graph
from .closure import Closure, SurfaceParameters, lobe, parameters
from .evaluate import Evaluator
from .node_call import NodeCall
from .normal_map import bend_normal
from .points import Points, surface_points
from .surface import closure_at
from .two_lobes import lobe_nodes
from .volume import has_surface

HEIGHT_UNIT = 0.025  # world units of displacement at height 1 (docs/scene-input.md 4.6)
ONE_TRIANGLE = TriangleMesh(np.eye(3, dtype=np.float32)[None], np.full((1, 3, 3), 3 ** -0.5, np.float32), {}, None, {},
                            None, np.zeros(1, np.int32), np.float32([(0, 0, 0), (1, 1, 1)]))


class EvaluatedMaterial(NamedTuple):
    """A material at some points, and what else the result depends on."""

    surface: SurfaceParameters
    height: np.ndarray                 # (..., 1) in the units of a tile
    depends_on_ray: bool = False       # on the kind of ray
    depends_on_side: bool = False      # on the side of the faces
    depends_on_instance: bool = False
    depends_on_scale: bool = False     # on the size of the instance


def evaluate_material(material: Material, points: Points, report: Report, baker=None,
                      keeps_lobes: bool = False) -> EvaluatedMaterial:
    """baker: as of Evaluator. keeps_lobes: as of MaterialTiles."""
    tree = material.node_tree
    if tree is None:
        color = np.array(material.diffuse_color[:3], np.float32)
        return EvaluatedMaterial(parameters(lobe(color)), np.zeros(1, np.float32))
    evaluator = Evaluator(points, tree.conventions, report, material.name, baker)
    evaluator.material_index = material.pass_index
    output = graph.output_node(tree)
    output = None if output is None else NodeCall(evaluator, output)
    evaluator.keeps_lobes = keeps_lobes and output is not None and lobe_nodes(output) is not None
    closure = Closure() if output is None else closure_at(output, "Surface")
    by_ray, by_side = evaluator.depends_on_ray, evaluator.depends_on_side  # displacement is the same for all rays
    if (closure.emission < 0).any():
        report.approximated(material.name, "negative light is ignored")
    if not evaluator.has_shader and has_surface(material):
        report.approximated(material.name, "no surface shader is connected to the Material Output, so it is black")
    displacement, surface = _displacement(material, output), parameters(closure)
    if material.displacement_method == "BUMP" and displacement.ndim > 1:
        surface.normal = bend_normal(output, surface.normal, displacement)
        displacement = np.zeros(1, np.float32)
    return EvaluatedMaterial(surface, np.clip(displacement / HEIGHT_UNIT, -1, 1), by_ray, by_side,
                             evaluator.depends_on_instance, evaluator.depends_on_scale)


class _BakerProbe:
    """Stands in for a baker and remembers whether it was needed."""

    was_needed = False

    def bake(self, n):
        self.was_needed = True
        raise RuntimeError("it is baked later")


def needs_baking(material: Material) -> bool:
    """Whether it has nodes that a baker has to evaluate."""
    probe = _BakerProbe()
    evaluate_material(material, surface_points(ONE_TRIANGLE, Instance()), Report(), probe)
    return probe.was_needed


def _displacement(material, output: NodeCall | None) -> np.ndarray:
    """World units along the normal, by what reaches the Displacement input."""
    n = None if output is None else output.source("Displacement")
    if n is None or n.points.is_displaced:
        return np.zeros(1, np.float32)
    if n.kind != "ShaderNodeDisplacement":
        n.approximated("its displacement is ignored")
        return np.zeros(1, np.float32)
    height = (n["Height"] - n["Midlevel"]) * n["Scale"]
    return height * _normal_scale(n) if n.node.space == "OBJECT" else height


def _normal_scale(n: NodeCall) -> np.ndarray:
    """(1,), or (m, 1, 1, 1) of an object scaled unevenly: how much its matrix lengthens the normal of a triangle."""
    linear = n.linear_matrix()
    scale = np.linalg.svd(linear, compute_uv=False)
    if np.ptp(scale) < 1e-3 * scale.max():
        return scale[:1].astype(np.float32)
    normals = face_normals(n.points.corners)
    return np.linalg.norm(normals @ linear.T, axis=1).astype(np.float32)[:, None, None, None]
