# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials, worlds and lamps with their node trees as plain objects, named as in `bpy.types` (copying/trees.py)."""
from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from types import SimpleNamespace

import numpy as np

from ....model.pictures import LUMINANCE


@dataclass(eq=False)
class Material:
    name: str
    node_tree: Tree | None
    pass_index: int
    diffuse_color: tuple
    displacement_method: str
    latent: tuple[float, ...] | None = None  # nine numbers that published weights take for its nodes


@dataclass(eq=False)
class World:
    name: str
    node_tree: Tree | None
    color: tuple
    hidden: int             # rays that do not see it, a set of Ray
    widths: list[int]       # of all images in its own tree
    has_groups: bool


class Lamp(SimpleNamespace):
    """A Light with all its settings: `type`, `energy`, ..., `is_portal` and `node_tree`."""


@dataclass(frozen=True, eq=False)
class Conventions:
    """The file's colours are numbers in Linear Rec.709, or from Blender 5 on in the space that the user has chosen."""

    rec709: np.ndarray      # (3, 3) f32 its red, green and blue in that space
    voronoi_uses_pcg: bool  # see rf2_engine/compat.py

    def from_rec709(self, colors: np.ndarray) -> np.ndarray:
        """(..., 3) linear colours."""
        return colors @ self.rec709

    def luminance(self, colors: np.ndarray) -> np.ndarray:
        """(..., 1) of scene-linear colours (..., 3)."""
        return colors @ self._weights

    @cached_property
    def _weights(self) -> np.ndarray:
        return (np.linalg.inv(self.rec709) @ LUMINANCE[:, None]).astype(np.float32)


class Sockets(list):
    """Sockets by number, or by name: the first one with that name."""

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
    """A shader node; the settings of its kind, such as `operation`, are further attributes.

    Data-blocks that it refers to are replaced: `node_tree` a Tree, `image` a Picture, `object` a Frame,
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
        """The nodes of the tree and of the groups in it."""
        for node in self.nodes:
            yield node
            if (group := getattr(node, "node_tree", None)) is not None:
                yield from group.all_nodes()


@dataclass(frozen=True)
class Frame:
    """The frame of an object that is used for texture coordinates."""

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
