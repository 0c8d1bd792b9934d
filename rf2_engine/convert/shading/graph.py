# SPDX-License-Identifier: GPL-3.0-or-later
"""Walking a shader node graph: which node really feeds a socket.

A socket inside a node group is only meaningful together with the group nodes that lead to it; `frames` is that path,
a tuple of group nodes from the outside in.
"""
from __future__ import annotations

MAX_DEPTH = 1000


def output_node(tree):
    """The output node that Cycles uses, or None."""
    return tree.get_output_node("CYCLES") if tree is not None else None


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
        link = next((link for link in socket.links if link.is_valid and not link.is_muted), None)
        if link is None:
            return socket, None, frames
        node, output = link.from_node, link.from_socket
        if node.bl_idname == "NodeReroute":
            socket = node.inputs[0]
        elif node.mute:
            bypass = next((inner for inner in node.internal_links if inner.to_socket == output), None)
            if bypass is None:
                return socket, None, frames
            socket = bypass.from_socket
        elif node.bl_idname == "ShaderNodeGroup" and node.node_tree is not None:
            inner = _group_output(node.node_tree, output.identifier)
            if inner is None:
                return socket, None, frames
            socket, frames = inner, frames + (node,)
        elif node.bl_idname == "NodeGroupInput" and frames:
            outer = next((s for s in frames[-1].inputs if s.identifier == output.identifier), None)
            if outer is None:
                return socket, None, frames
            socket, frames = outer, frames[:-1]
        else:
            return socket, output, frames
    return socket, None, frames


def _group_output(tree, identifier):
    for node in tree.nodes:
        if node.bl_idname == "NodeGroupOutput" and node.is_active_output:
            return next((s for s in node.inputs if s.identifier == identifier), None)
    return None
