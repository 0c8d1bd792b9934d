# SPDX-License-Identifier: GPL-3.0-or-later
"""Walking a shader node graph (data/blocks.py): find the node that feeds a socket.

A socket inside a node group is only meaningful together with the group nodes that lead to it; `frames` is that path,
a tuple of group nodes from the outside in.
"""
from __future__ import annotations

MAX_DEPTH = 1000


def output_node(tree):
    """The output node that Cycles uses, or None."""
    return tree.output if tree is not None else None


def find_input(node, *names):
    """The first enabled input called one of `names`, or None. Nodes such as Mix hold several inputs of one name."""
    for name in names:
        for socket in node.inputs:
            if socket.name == name and socket.enabled:
                return socket
    return None


def source(socket, frames=()):
    """Follow an input socket through reroutes, groups and muted nodes.

    Returns (input socket whose default applies when nothing is linked, output socket or None, frames of the result).
    None in place of a socket, which not every output node has, is fed by nothing.
    """
    if socket is None:
        return None, None, frames
    for _ in range(MAX_DEPTH):
        output = socket.source
        if output is None:
            return socket, None, frames
        node = output.node
        if node.bl_idname == "NodeReroute":
            socket = node.inputs[0]
        elif node.mute:
            if output not in node.bypass:
                return socket, None, frames
            socket = node.bypass[output]
        elif node.bl_idname == "ShaderNodeGroup" and node.node_tree is not None:
            inner = _of_identifier(node.node_tree.output, output.identifier)
            if inner is None:
                return socket, None, frames
            socket, frames = inner, frames + (node,)
        elif node.bl_idname == "NodeGroupInput" and frames:
            outer = _of_identifier(frames[-1], output.identifier)
            if outer is None:
                return socket, None, frames
            socket, frames = outer, frames[:-1]
        else:
            return socket, output, frames
    return socket, None, frames


def _of_identifier(node, identifier):
    """The input of a node, which may be None."""
    return next((socket for socket in node.inputs if socket.identifier == identifier), None) if node else None


def has_node(tree, kind: str) -> bool:
    """Whether a node of this bl_idname is in a tree, which may be None, or in a group in it."""
    return tree is not None and any(node.bl_idname == kind for node in tree.all_nodes())
