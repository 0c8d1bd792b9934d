# SPDX-License-Identifier: GPL-3.0-or-later
"""Shader node trees copied out of Blender: the nodes that lead to an output, with all that they refer to."""
from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np

from ... import compat
from ..data.conventions import Conventions
from ..data.nodes import Curve, Curves, Frame, Node, Socket, Tree
from ..shading import ies
from .images import Images

VALUES = {"BOOLEAN", "INT", "FLOAT", "STRING", "ENUM"}
TEXTURES = {"ShaderNodeTexImage", "ShaderNodeTexEnvironment"}
TABLE_SIZE = 1024  # values of a ramp or a curve


class Trees:
    """The trees of one conversion; groups are copied once."""

    def __init__(self, images: Images, conventions: Conventions):
        self.images, self.conventions = images, conventions
        self._groups: dict[int, Tree] = {}
        self._names: dict[str, list[str]] = {}  # by kind of node: the settings that are values

    def copied(self, tree) -> Tree:
        """Of a material, a lamp or a world."""
        return self._filled(Tree(tree.name, self.conventions), tree, tree.get_output_node("CYCLES"))

    def _group(self, tree) -> Tree:
        key = tree.as_pointer()
        if key not in self._groups:
            end = next((n for n in tree.nodes if n.bl_idname == "NodeGroupOutput" and n.is_active_output), None)
            self._groups[key] = self._filled(Tree(tree.name, self.conventions), tree, end)
        return self._groups[key]

    def _filled(self, made: Tree, tree, end) -> Tree:
        if end is None:
            return made
        feeding = {}
        for link in tree.links:
            if link.is_valid and not link.is_muted:
                feeding.setdefault(link.to_socket.as_pointer(), link)
        waiting, nodes, sockets = [end], {}, {}  # both by pointer
        while waiting:
            node = waiting.pop()
            if node.as_pointer() not in nodes:
                nodes[node.as_pointer()] = self._node(node, sockets)
                waiting += [feeding[s.as_pointer()].from_node for s in node.inputs if s.as_pointer() in feeding]
        for to, link in feeding.items():
            if to in sockets:
                sockets[to].source = sockets[link.from_socket.as_pointer()]
        made.output, made.nodes = nodes[end.as_pointer()], list(nodes.values())
        return made

    def _node(self, node, sockets: dict[int, Socket]) -> Node:
        """sockets: by pointer, to which its own are added."""
        made = Node(node.bl_idname, node.bl_label, node.name, node.mute)
        for of, to in (node.inputs, made.inputs), (node.outputs, made.outputs):
            for socket in of:
                sockets[socket.as_pointer()] = copy = _socket(socket, made)
                to.append(copy)
        for link in node.internal_links if node.mute else ():
            made.bypass.setdefault(sockets[link.to_socket.as_pointer()], sockets[link.from_socket.as_pointer()])
        for name in self._values(node):
            setattr(made, name, plain(getattr(node, name)))
        self._refer(made, node)
        return made

    def _values(self, node) -> list[str]:
        if node.bl_idname not in self._names:
            common = bpy.types.Node.bl_rna.properties
            self._names[node.bl_idname] = [prop.identifier for prop in node.bl_rna.properties
                                           if prop.type in VALUES and prop.identifier not in common]
        return self._names[node.bl_idname]

    def _refer(self, made: Node, node) -> None:
        """What the settings of a node point to."""
        kind = node.bl_idname
        if kind in TEXTURES:
            made.image = self.images.picture(node)
        elif kind == "ShaderNodeTexCoord":
            made.object = node.object and Frame(np.array(node.object.matrix_world.inverted_safe(), np.float32))
        elif kind == "ShaderNodeTexIES":
            made.profile = _profile(node)
        elif kind == "ShaderNodeValToRGB":
            made.color_ramp = np.array([node.color_ramp.evaluate(x) for x in np.linspace(0, 1, TABLE_SIZE)], np.float32)
        elif getattr(node, "mapping", None) is not None:
            made.mapping = _curves(node.mapping)
        elif hasattr(node, "node_tree"):
            made.node_tree = node.node_tree and self._group(node.node_tree)


def _socket(socket, node: Node) -> Socket:
    return Socket(node, socket.name, socket.identifier, socket.type, socket.enabled,
                  plain(getattr(socket, "default_value", 0.0)), socket.is_linked)


def plain(value):
    """Numbers, texts and sets of them as they are, vectors and colours as tuples; 0.0 for data-blocks."""
    if isinstance(value, (bool, int, float, str, set)):
        return value
    try:
        return tuple(value)
    except TypeError:
        return 0.0


def _curves(mapping) -> Curves:
    mapping.initialize()
    found = []
    for curve in mapping.curves:
        first, last = (curve.points[i].location[0] for i in (0, -1))
        table = np.array([mapping.evaluate(curve, at) for at in np.linspace(first, last, TABLE_SIZE)])
        found.append(Curve(first, last, table))
    return Curves(mapping.extend, found)


def _profile(node) -> ies.Profile | None:
    """None where it cannot be read."""
    try:
        text = node.ies.as_string() if node.mode == "INTERNAL" else Path(
            bpy.path.abspath(node.filepath)).read_text(errors="replace")
        return ies.read(text, compat.ies_of_one_column_bulges())
    except (AttributeError, OSError, ValueError, IndexError):
        return None
