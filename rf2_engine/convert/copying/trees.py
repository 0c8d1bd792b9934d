# SPDX-License-Identifier: GPL-3.0-or-later
"""Shader node trees copied out of Blender: the nodes that lead to an output, with all that they refer to."""
from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np

from ... import compat
from ..data.blocks import Conventions, Curve, Curves, Frame, Node, Socket, Tree
from ..shading import ies
from .images import Images, UnreadImages

VALUES = {"BOOLEAN", "INT", "FLOAT", "STRING", "ENUM"}
TEXTURES = {"ShaderNodeTexImage", "ShaderNodeTexEnvironment"}
TABLE_SIZE = 1024  # values of a ramp or a curve


class Trees:
    """The trees of one conversion; groups are copied once."""

    def __init__(self, images: Images | UnreadImages, conventions: Conventions):
        self.images, self.conventions = images, conventions
        self._groups: dict[int, Tree] = {}
        self._names: dict[str, list[str]] = {}  # by kind of node: the settings that are values

    def copied(self, tree) -> Tree:
        """A copy of the tree of a material, a lamp or a world."""
        return self._with_nodes(Tree(tree.name, self.conventions), tree, tree.get_output_node("CYCLES"))

    def _group(self, tree) -> Tree:
        key = tree.as_pointer()
        if key not in self._groups:
            end = next((n for n in tree.nodes if n.bl_idname == "NodeGroupOutput" and n.is_active_output), None)
            self._groups[key] = self._with_nodes(Tree(tree.name, self.conventions), tree, end)
        return self._groups[key]

    def _with_nodes(self, copied: Tree, tree, end) -> Tree:
        if end is None:
            return copied
        links_by_input = {}
        for link in tree.links:
            if link.is_valid and not link.is_muted:
                links_by_input.setdefault(link.to_socket.as_pointer(), link)
        remaining, nodes, sockets = [end], {}, {}  # both by pointer
        while remaining:
            node = remaining.pop()
            if node.as_pointer() not in nodes:
                nodes[node.as_pointer()] = self._node(node, sockets)
                inputs = (socket.as_pointer() for socket in node.inputs)
                remaining += [links_by_input[socket].from_node for socket in inputs if socket in links_by_input]
        for socket_pointer, link in links_by_input.items():
            if socket_pointer in sockets:
                sockets[socket_pointer].source = sockets[link.from_socket.as_pointer()]
        copied.output, copied.nodes = nodes[end.as_pointer()], list(nodes.values())
        return copied

    def _node(self, node, sockets: dict[int, Socket]) -> Node:
        """A copy of a node; its sockets are added to `sockets` by the pointers of the originals."""
        copied = Node(node.bl_idname, node.bl_label, node.name, node.mute)
        for originals, copies in (node.inputs, copied.inputs), (node.outputs, copied.outputs):
            for socket in originals:
                sockets[socket.as_pointer()] = copied_socket = _socket(socket, copied)
                copies.append(copied_socket)
        for link in node.internal_links if node.mute else ():
            copied.bypass.setdefault(sockets[link.to_socket.as_pointer()], sockets[link.from_socket.as_pointer()])
        for name in self._values(node):
            setattr(copied, name, plain(getattr(node, name)))
        self._refer(copied, node)
        return copied

    def _values(self, node) -> list[str]:
        if node.bl_idname not in self._names:
            common = bpy.types.Node.bl_rna.properties
            self._names[node.bl_idname] = [prop.identifier for prop in node.bl_rna.properties
                                           if prop.type in VALUES and prop.identifier not in common]
        return self._names[node.bl_idname]

    def _refer(self, copied: Node, node) -> None:
        """Copy what the settings of a node refer to."""
        kind = node.bl_idname
        if kind in TEXTURES:
            copied.image = self.images.picture(node)
        elif kind == "ShaderNodeTexCoord":
            copied.object = node.object and Frame(np.array(node.object.matrix_world.inverted_safe(), np.float32))
        elif kind == "ShaderNodeTexIES":
            copied.profile = _profile(node)
        elif kind == "ShaderNodeValToRGB":
            copied.color_ramp = np.array([node.color_ramp.evaluate(x) for x in np.linspace(0, 1, TABLE_SIZE)],
                                         np.float32)
        elif getattr(node, "mapping", None) is not None:
            copied.mapping = _curves(node.mapping)
        elif hasattr(node, "node_tree"):
            copied.node_tree = node.node_tree and self._group(node.node_tree)


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
    curves = []
    for curve in mapping.curves:
        first, last = (curve.points[i].location[0] for i in (0, -1))
        table = np.array([mapping.evaluate(curve, at) for at in np.linspace(first, last, TABLE_SIZE)])
        curves.append(Curve(first, last, table))
    return Curves(mapping.extend, curves)


def _profile(node) -> ies.Profile | None:
    """The light distribution of an IES node; None if it cannot be read."""
    try:
        text = node.ies.as_string() if node.mode == "INTERNAL" else Path(
            bpy.path.abspath(node.filepath)).read_text(errors="replace")
        return ies.read(text, compat.ies_of_one_column_bulges())
    except (AttributeError, OSError, ValueError, IndexError):
        return None
