# SPDX-License-Identifier: GPL-3.0-or-later
"""Describe the node trees of a world as text: equal texts mean equal worlds."""
from __future__ import annotations

from collections.abc import Iterator

import bpy

VALUES = {"BOOLEAN", "INT", "FLOAT", "STRING", "ENUM"}
IN_EDITOR = {"location", "location_absolute", "width", "height", "select", "show_options", "show_preview"}


def node_trees(world: bpy.types.World) -> Iterator[tuple[bpy.types.ID, str, bpy.types.NodeTree]]:
    """The node trees of a world and of all groups in it: data-block that owns it, path to it from there, and it."""
    waiting, visited = [(world, "node_tree.", world.node_tree)], set()
    while waiting:
        owner, prefix, tree = waiting.pop()
        if tree is not None and tree.as_pointer() not in visited:
            visited.add(tree.as_pointer())
            yield owner, prefix, tree
            waiting += [(node.node_tree, "", node.node_tree) for node in tree.nodes if getattr(node, "node_tree", None)]


def describe_world(world: bpy.types.World) -> str:
    """The text of a world with nodes."""
    parts = [world.name_full]
    for _, _, tree in node_trees(world):
        for node in tree.nodes:
            parts.append(repr([node.bl_idname, *_values(node), *(getattr(s, "default_value", None) and _plain(
                s.default_value) for s in (*node.inputs, *node.outputs))]))
        parts += [repr((link.from_node.name, link.from_socket.identifier, link.to_node.name, link.to_socket.identifier,
                        link.is_muted)) for link in tree.links]
    return "\n".join(parts)


def _values(data, depth: int = 2) -> list:
    """The text of a node or of its values: numbers, texts, data-blocks by name, and places of objects."""
    values = []
    for prop in data.bl_rna.properties:
        name = prop.identifier
        if name in IN_EDITOR or name.startswith("bl_") or name == "rna_type":
            continue
        value = getattr(data, name, None)
        if prop.type in VALUES:
            values.append((name, _plain(value)))
        elif isinstance(value, bpy.types.Object):
            values.append((name, value.name_full, [tuple(row) for row in value.matrix_world]))
        elif isinstance(value, bpy.types.ID):
            values.append((name, value.name_full))
        elif prop.type == "POINTER" and value is not None and depth and not isinstance(value, bpy.types.Node):
            values.append((name, _values(value, depth - 1)))
        elif prop.type == "COLLECTION" and depth and name in ("elements", "curves", "points"):
            values.append((name, [_values(item, depth - 1 if name != "curves" else 1) for item in value]))
    return values


def _plain(value):
    return tuple(value) if hasattr(value, "__len__") and not isinstance(value, (str, set)) else value
