# SPDX-License-Identifier: GPL-3.0-or-later
"""A scene in which every pass says something, rendered by our engine and by Cycles."""
import bpy

from bl_ext.user_default.renderformer_v2.rf2_engine import passes

from tests.rf2_engine.f12 import cube, material, mesh_object, press_f12, sun

SAMPLES = 4


def tick(layer, keys):
    for p in passes.PASSES:
        if p.key in keys and p.setting:
            owner, _, name = p.setting.rpartition(".")
            setattr(getattr(layer, owner) if owner else layer, name, True)


def tick_own(layer):
    """Cryptomattes and shader AOVs."""
    layer.use_pass_cryptomatte_object = layer.use_pass_cryptomatte_material = layer.use_pass_cryptomatte_asset = True
    for name, kind in (("Tint", "COLOR"), ("Wear", "VALUE")):
        aov = layer.aovs.add()
        aov.name, aov.type = name, kind


def write_aovs(of):
    tree = of.node_tree
    tree.nodes.new("ShaderNodeOutputAOV").aov_name = "Tint"
    tree.nodes[-1].inputs["Color"].default_value = (0.2, 0.4, 0.6, 1)
    tree.nodes.new("ShaderNodeOutputAOV").aov_name = "Wear"
    tree.nodes[-1].inputs["Value"].default_value = 0.75


def build(scene):
    """A cube that shines, one that moves, a floor with UVs, glass in front, and as many samples as Cycles takes."""
    red, shining, glass = material("Red", (0.8, 0.1, 0.1)), material("Shining", (0.1, 0.5, 0.2)), material("Glass")
    write_aovs(red)
    red.pass_index = 5
    shining.node_tree.nodes["Principled BSDF"].inputs["Emission Color"].default_value = (1, 0.6, 0.2, 1)
    shining.node_tree.nodes["Principled BSDF"].inputs["Emission Strength"].default_value = 0.5
    glass.node_tree.nodes["Principled BSDF"].inputs["Transmission Weight"].default_value = 1
    moving = cube(scene, "Moving", (-1.2, 1, 0.2), red)
    moving.rotation_euler, moving.pass_index = (0.2, 0.3, 0.4), 3
    for frame, x in ((1, -1.2), (3, -0.2)):
        moving.location.x = x
        moving.keyframe_insert("location", frame=frame)
    cube(scene, "Lantern", (1.4, 0.5, -0.3), shining).parent = moving
    mesh_object(scene, "Pane", [(0, -2, -0.5), (0.9, -2, -0.5), (0.9, -2, 0.5), (0, -2, 0.5)], [(0, 1, 2, 3)], glass)
    floor = mesh_object(scene, "Floor", [(-5, -3, -1.4), (5, -3, -1.4), (5, 6, -1.4), (-5, 6, -1.4)], [(0, 1, 2, 3)])
    layer = floor.data.uv_layers.new()
    layer.uv.foreach_set("vector", [0, 0, 1, 0, 1, 1, 0, 1])
    sun(scene)
    scene.renderformer_v2.guide_samples = scene.cycles.samples = SAMPLES
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
    scene.frame_set(2)


def with_cycles(scene, tmp_path):
    scene.render.engine = "CYCLES"
    return press_f12(scene, tmp_path)


def compositor(scene):
    if bpy.app.version >= (5, 0, 0):
        scene.compositing_node_group = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
        return scene.compositing_node_group
    scene.use_nodes = True
    scene.node_tree.nodes.clear()
    return scene.node_tree


def composite_into(scene, socket):
    """Make the value of `socket` the picture that the graph gives."""
    tree = socket.node.id_data
    if bpy.app.version >= (5, 0, 0):
        tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        tree.links.new(socket, tree.nodes.new("NodeGroupOutput").inputs["Image"])
    else:
        tree.links.new(socket, tree.nodes.new("CompositorNodeComposite").inputs["Image"])
