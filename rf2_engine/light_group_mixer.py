# SPDX-License-Identifier: GPL-3.0-or-later
"""Compositor nodes that mix the light groups of a picture anew, with a color and a strength for each: no render."""
from __future__ import annotations

import bpy

from . import compat
from .registering import classes

NAME = "Light Group Mixer"
STEP = 200   # between columns of nodes
SOCKETS = 3  # of a light group: its light, color and strength


def add_mixer(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> bpy.types.Node:
    """The mixer of a view layer in the scene's compositor, which shows it unless it shows something else already."""
    tree, is_new = compat.compositor(scene), False
    if tree is None:
        tree, is_new = compat.add_compositor(scene), True
    output = compat.compositor_output(tree)
    shown = output.inputs["Image"].links
    view_layer.update_render_passes()  # for the sockets of the passes
    layer, mixer = tree.nodes.new("CompositorNodeRLayers"), tree.nodes.new("CompositorNodeGroup")
    layer.scene, layer.layer = scene, view_layer.name
    names = [group.name for group in view_layer.lightgroups]
    mixer.node_tree = _create_group(names)
    mixer.label, mixer.width = NAME, 240
    output.location.x, mixer.location.x, layer.location.x = 3 * STEP, 1.5 * STEP, 0
    tree.links.new(layer.outputs["Image"], mixer.inputs["Image"])
    for name, socket in zip(names, list(mixer.inputs)[1::SOCKETS], strict=True):
        tree.links.new(layer.outputs[f"Combined_{name}"], socket)
    if is_new or not shown or shown[0].from_node.bl_idname == layer.bl_idname:
        tree.links.new(mixer.outputs["Image"], output.inputs["Image"])
    return mixer


def _create_group(names: list[str]) -> bpy.types.NodeTree:
    """Image + sum of light x (color x strength - 1): what is in no group stays, and so does alpha."""
    group = bpy.data.node_groups.new(NAME, "CompositorNodeTree")
    group.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    group.interface.new_socket("Image", in_out="INPUT", socket_type="NodeSocketColor")
    for name in names:
        for title, kind, value in ((name, "Color", (0, 0, 0, 1)), (f"{name} Color", "Color", (1, 1, 1, 1)),
                                   (f"{name} Strength", "Float", 1)):
            socket = group.interface.new_socket(title, in_out="INPUT", socket_type=f"NodeSocket{kind}")
            socket.default_value = value
        socket.min_value = 0
    given, result = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    total = given.outputs["Image"]
    for row in range(len(names)):
        light, color, strength = given.outputs[1 + SOCKETS * row:][:SOCKETS]
        change = _math(group, "MULTIPLY_ADD", color, strength)
        change.inputs[2].default_value = (-1, -1, -1)
        light = _math(group, "MULTIPLY", light, change.outputs[0])
        add = group.nodes.new("ShaderNodeMix")
        add.data_type, add.blend_type, add.clamp_factor = "RGBA", "ADD", False
        add.inputs["Factor"].default_value = 1
        first, second = (socket for socket in add.inputs if socket.type == "RGBA")
        group.links.new(total, first)
        group.links.new(light.outputs[0], second)
        total = next(socket for socket in add.outputs if socket.type == "RGBA")
        for column, node in enumerate((change, light, add), 1):
            node.location = column * STEP, -row * STEP
    group.links.new(total, result.inputs["Image"])
    result.location.x = 4 * STEP
    return group


def _math(group: bpy.types.NodeTree, operation: str, *sockets: bpy.types.NodeSocket) -> bpy.types.Node:
    node = group.nodes.new("ShaderNodeVectorMath")
    node.operation = operation
    for socket, end in zip(sockets, node.inputs):
        group.links.new(socket, end)
    return node


class RENDERFORMER_OT_add_light_group_mixer(bpy.types.Operator):
    bl_idname = "renderformer_v2.add_light_group_mixer"
    bl_label = "Add Light Group Mixer"
    bl_description = ("Add compositor nodes with a color and a strength for each light group of this view layer. They "
                      "change the picture without another render")
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return context.view_layer and len(context.view_layer.lightgroups) > 0

    def execute(self, context):
        mixer = add_mixer(context.scene, context.view_layer)
        if not mixer.outputs["Image"].links:
            self.report({"INFO"}, "The compositor shows other nodes: connect the Image of the Light Group Mixer")
        return {"FINISHED"}


register, unregister = classes(RENDERFORMER_OT_add_light_group_mixer)
