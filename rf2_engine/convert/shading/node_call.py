# SPDX-License-Identifier: GPL-3.0-or-later
"""The argument of a node's function: the node, the values of its inputs, and where it is evaluated."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..data.arrays import join
from . import graph

OF_A_NODE = 'node "'  # how a remark about a node begins


class Unknown(Exception):
    """Why a node cannot be evaluated: it is baked, or the input that it feeds keeps its own value."""


class DependsOnView(Unknown):
    """It cannot be baked either."""


@dataclass(frozen=True)
class NodeCall:
    """One evaluation of a node. Values are arrays (..., 1) or (..., 3) as in evaluate.py."""

    evaluator: object      # Evaluator
    node: object           # Node (data/blocks.py)
    output: object = None  # Socket whose value is computed; None for a shader
    frames: tuple = ()     # group nodes that lead to the node (graph.py)

    @property
    def kind(self) -> str:
        return self.node.bl_idname

    @property
    def points(self):
        return self.evaluator.points

    @property
    def conventions(self):
        return self.evaluator.conventions

    def __getitem__(self, key) -> np.ndarray:
        """`n["Fac", "Factor"]`: value of the first enabled input that has one of these names; `n[0]`: of input 0."""
        socket = self._input(key)
        if socket is None:
            name = key if isinstance(key, str) else " or ".join(key)
            self.approximated(f'it has no input "{name}" in this version of Blender, 0 is used')
            return np.zeros(1, np.float32)
        return self.evaluator.value(socket, self.frames)

    def get(self, key, default=0.0) -> np.ndarray:
        """Like `n[key]`, but `default` where this version of Blender knows no such input."""
        socket = self._input(key)
        return np.atleast_1d(np.float32(default)) if socket is None else self.evaluator.value(socket, self.frames)

    def values(self) -> list[np.ndarray]:
        """Values of all inputs in their order."""
        return [self.evaluator.value(socket, self.frames) for socket in self.node.inputs]

    def linked(self, key) -> np.ndarray | None:
        """Value that a link brings to an input; None if there is none."""
        socket = self._input(key)
        if socket is None or graph.source(socket, self.frames)[1] is None:
            return None
        return self.evaluator.value(socket, self.frames)

    def coordinates(self) -> np.ndarray:
        """The Vector input of a texture; unlinked it means the direction in the world, elsewhere Generated."""
        vector, points = self.linked("Vector"), self.points
        if vector is not None:
            return vector
        if points.direction is not None:
            return points.direction
        if points.corners is None:
            self.approximated("a texture in a light or in a volume is evaluated at one point")
            return np.zeros(3, np.float32)
        return points.generated

    def coordinates_in(self, dimensions: str) -> np.ndarray:
        """(..., d) coordinates of a texture of "1D" to "4D": of its Vector input, of W, or of both."""
        if dimensions == "1D":
            return self["W"]
        space = self.coordinates()[..., :2 if dimensions == "2D" else 3]
        return join(space, self["W"]) if dimensions == "4D" else space

    def instance(self):
        """The Instance of the surface; the value then holds for this instance alone."""
        self.evaluator.depends_on_instance = True
        return self.points.instance

    def linear_matrix(self) -> np.ndarray:
        """(3, 3) matrix of the instance, for values that depend on its size but not on its rotation."""
        self.evaluator.depends_on_scale = True
        return self.points.instance.matrix[:3, :3]

    def source(self, key) -> NodeCall | None:
        """The node that feeds an input, None if there is none."""
        socket = self._input(key)
        _, output, frames = graph.source(socket, self.frames) if socket is not None else (None, None, ())
        return None if output is None else NodeCall(self.evaluator, output.node, output, frames)

    def approximated(self, message: str) -> None:
        """Report what of this node is lost, as a sentence about "it"."""
        name, kind = self.node.name, self.node.bl_label
        label = f'{OF_A_NODE}{name}"' + ("" if name.startswith(kind) else f" ({kind})")
        within = "".join(f' in "{group.node_tree.name}"' for group in self.frames)
        self.evaluator.report.approximated(self.evaluator.owner, f"{label}{within}: {message}")

    def bake_or_report(self, message: str) -> None:
        """Have the node baked where the user allows it; else report what of it is lost."""
        if self.evaluator.baker:
            raise Unknown("it cannot be evaluated")
        self.approximated(message)

    def simplified(self, message: str) -> None:
        """Report what the surface loses: once, however many of its nodes lose the same."""
        self.evaluator.report.approximated(self.evaluator.owner, message)

    def _input(self, key):
        if isinstance(key, int):
            return self.node.inputs[key]
        return graph.find_input(self.node, *([key] if isinstance(key, str) else key))
