# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluating a shader node graph over many points at once.

Every value is an array (..., 1) for numbers or (..., 3) for colours (scene-linear) and vectors. Values that do
not depend on the point keep the bare shape (1,) or (3,), so "is this material homogeneous" is a question of `ndim`.
"""
from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..data.blocks import Conventions
from ..data.report import Report
from . import graph
from .functions import FUNCTIONS
from .node_call import DependsOnView, NodeCall, Unknown
from .points import Points

LONGEST_CHAIN = 150  # nodes: Python allows 1000 nested calls


class Evaluator:
    """Values of input sockets of one data-block `owner` over `points`; remembers what it has computed."""

    def __init__(self, points: Points, conventions: Conventions, report: Report, owner: str, baker=None):
        self.points, self.conventions, self.report = points, conventions, report
        self.owner, self.baker = owner, baker
        self.material_index = 0
        self.keeps_lobes = False       # whether the network gets both lobes of the surface (two_lobes.py)
        self.depends_on_ray = False    # whether a Light Path was evaluated
        self.depends_on_side = False   # whether it asks which side of a face it is
        self.has_shader = False        # whether any shader was
        self.depends_on_instance = False  # whether the result holds for one instance alone
        self.depends_on_scale = False  # whether it holds for instances of one size alone
        self._memo: dict = {}
        self._depth = 0

    def value(self, socket, frames=()) -> np.ndarray:
        """Value arriving at an input socket, (..., 1) or (..., 3) by the socket's own type."""
        end, output, inner = graph.source(socket, frames)
        if output is None:
            return self._cast(_default(end), socket.type, end.type)
        n = NodeCall(self, output.node, output, inner)
        result = self.evaluate_once(n, _computed, Unknown("the chain of nodes is too long"))
        if isinstance(result, Unknown):
            advice = "; bake it to an image" if self.baker else "; allow Bake Unsupported Nodes, or bake it to an image"
            n.approximated(f'{result}, so "{socket.name}" of "{socket.node.name}" keeps its own value'
                           + ("" if isinstance(result, DependsOnView) else advice))
            return _default(socket)
        return self._cast(result, socket.type, output.type)

    def evaluate_once(self, n: NodeCall, function: Callable, fallback):
        """function(n), computed once; `fallback` at the end of too long a chain, and where a node feeds itself."""
        key = function, n.node, n.output, n.frames
        if key in self._memo:
            return self._memo[key]
        if self._depth == LONGEST_CHAIN:
            return fallback
        self._depth += 1
        self._memo[key] = fallback
        try:
            self._memo[key] = function(n)
        finally:
            self._depth -= 1
        return self._memo[key]

    def _cast(self, value: np.ndarray, socket_type: str, from_type: str) -> np.ndarray:
        """Blender's implicit conversion: colour to number is luminance, vector to number is the mean."""
        if socket_type in ("VALUE", "INT", "BOOLEAN"):
            if value.shape[-1] == 1:
                return value
            return value.mean(axis=-1, keepdims=True) if from_type == "VECTOR" else self.conventions.luminance(value)
        if value.shape[-1] == 1:
            return np.repeat(value, 3, axis=-1)
        return value


def _computed(n: NodeCall) -> np.ndarray | Unknown:
    try:
        if n.kind not in FUNCTIONS:
            raise Unknown("it cannot be evaluated")
        with np.errstate(all="ignore"):
            return np.asarray(FUNCTIONS[n.kind](n), np.float32)
    except DependsOnView as reason:
        return reason
    except Unknown as reason:
        return reason if n.evaluator.baker is None or n.points.corners is None else _baked(n, reason)


def _baked(n: NodeCall, reason: Unknown) -> np.ndarray | Unknown:
    try:
        texels = n.evaluator.baker.bake(n)
    except RuntimeError as error:
        return Unknown(f"{reason}, and {error}")
    n.approximated(f'{reason}, so Cycles has baked it on "{n.points.instance.name}"')
    return texels


def _default(socket) -> np.ndarray:
    default = socket.default_value
    if isinstance(default, (int, float)):
        return np.array([default], np.float32)
    if isinstance(default, str):
        return np.zeros(1, np.float32)
    return np.array(default[:3], np.float32)
