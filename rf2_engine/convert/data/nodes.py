# SPDX-License-Identifier: GPL-3.0-or-later
"""Shader node trees as plain objects, named as in `bpy.types`: made by copying/trees.py."""
from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from .conventions import Conventions


class Sockets(list):
    """By number, or by name: the first one called so."""

    def __getitem__(self, key):
        if isinstance(key, str):
            return next(socket for socket in self if socket.name == key)
        return super().__getitem__(key)


@dataclass(eq=False)
class Socket:
    node: Node = field(repr=False)
    name: str
    identifier: str
    type: str
    enabled: bool
    default_value: float | str | tuple  # 0.0 where it has none
    is_linked: bool
    source: Socket | None = field(default=None, repr=False)  # the output that feeds it, by a link that counts


@dataclass(eq=False)
class Node:
    """With the settings of its own kind, such as `operation`, as further attributes.

    Instead of data-blocks it has what is known of them: `node_tree` a Tree, `image` a Picture, `object` a Frame,
    `color_ramp` a table, `mapping` a Curves, `profile` an ies.Profile.
    """

    bl_idname: str
    bl_label: str
    name: str
    mute: bool
    inputs: Sockets = field(default_factory=Sockets, repr=False)
    outputs: Sockets = field(default_factory=Sockets, repr=False)
    bypass: dict[Socket, Socket] = field(default_factory=dict, repr=False)  # of a muted one: output -> input


@dataclass(eq=False)
class Tree:
    """The nodes that lead to its output."""

    name: str
    conventions: Conventions
    output: Node | None = None  # the one that Cycles takes; of a group the active one
    nodes: list[Node] = field(default_factory=list, repr=False)

    def all_nodes(self) -> Iterator[Node]:
        """Those of the groups in it too."""
        for node in self.nodes:
            yield node
            if (group := getattr(node, "node_tree", None)) is not None:
                yield from group.all_nodes()


@dataclass(frozen=True)
class Frame:
    """Of an object that coordinates are taken from."""

    from_world: np.ndarray  # (4, 4) f32


@dataclass(frozen=True)
class Curve:
    first: float       # where it begins and ends
    last: float
    table: np.ndarray  # (k,) f64 at even steps between


@dataclass(frozen=True)
class Curves:
    extend: str  # EXTRAPOLATED or HORIZONTAL
    curves: list[Curve]
