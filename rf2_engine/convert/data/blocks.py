# SPDX-License-Identifier: GPL-3.0-or-later
"""Data-blocks with nodes as plain objects, named as in `bpy.types`; `node_tree` is None where nodes are not used."""
from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

from .nodes import Tree


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
    hidden_from: list[str]  # rays that do not meet it
    widths: list[int]       # of all images in its own tree
    has_groups: bool


class Lamp(SimpleNamespace):
    """A Light with all its settings: `type`, `energy`, ..., `is_portal` and `node_tree`."""
