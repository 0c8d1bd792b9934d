# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces that cameras, mirrors, shadow rays and bounced light see differently, beside Cycles."""
import pytest

from tests.rf2_engine.f12 import material
from tests.rf2_engine.rooms import assert_alike, beside_cycles, by_ray, lamp, panel, rectangle, remarks, room

RED, GREEN = ("BsdfDiffuse", {"Color": (0.9, 0.1, 0.1, 1)}), ("Emission", {"Color": (0.1, 0.5, 0.1, 1)})
BLUE, CLEAR = ("BsdfDiffuse", {"Color": (0.05, 0.1, 0.9, 1)}), ("BsdfTransparent", {})
MIRROR, GLASS = ("BsdfGlossy", {"Color": (0.9, 0.9, 0.9, 1), "Roughness": 0.05}), ("BsdfGlass", {"Roughness": 0.0})
LOOKS = {  # rays, what the others meet, what these meet
    "light for the camera alone, as unlit materials of glTF": (["Is Camera Ray"], CLEAR, GREEN),
    "light for the camera, matte for others": (["Is Camera Ray"], RED, GREEN),
    "a mirror for the camera, matte for others": (["Is Camera Ray"], RED, MIRROR),
    "nothing for the camera": (["Is Camera Ray"], RED, CLEAR),
    "another colour for diffuse rays": (["Is Diffuse Ray"], RED, BLUE),
    "nothing for diffuse rays": (["Is Diffuse Ray"], RED, CLEAR),
    "nothing for shadow rays": (["Is Shadow Ray"], RED, CLEAR),
    "glass without shadows": (["Is Shadow Ray", "Is Diffuse Ray"], GLASS, CLEAR),
}
FLAGS = ["visible_camera", "visible_diffuse", "visible_glossy", "visible_shadow"]


@pytest.mark.parametrize("look", LOOKS)
def test_light_meets_what_it_meets_in_cycles(scene, tmp_path, look):
    room(scene)
    panel(scene, by_ray("Trick", *LOOKS[look]))
    lamp(scene)
    ours, cycles = beside_cycles(scene, tmp_path)
    assert_alike(ours, cycles)
    assert "no surface shader" not in remarks()


@pytest.mark.parametrize("flag", FLAGS)
def test_rays_pass_what_is_hidden_from_them(scene, tmp_path, flag):
    room(scene)
    hidden = panel(scene, None)
    setattr(hidden, flag, False)
    lamp(scene)
    ours, cycles = beside_cycles(scene, tmp_path)
    assert_alike(ours, cycles)


@pytest.mark.parametrize("rays", ["Is Glossy Ray", "Is Diffuse Ray"])
def test_mirrors_show_the_world_that_glossy_rays_see(scene, tmp_path, rays):
    tree = scene.world.node_tree
    mix, path = tree.nodes.new("ShaderNodeMixRGB"), tree.nodes.new("ShaderNodeLightPath")
    mix.inputs[1].default_value, mix.inputs[2].default_value = (0.1, 0.1, 0.5, 1), (0.8, 0.5, 0.2, 1)
    tree.links.new(path.outputs[rays], mix.inputs[0])
    tree.links.new(mix.outputs[0], tree.nodes["Background"].inputs["Color"])
    rectangle(scene, "Floor", (-3, -3, 0), (0, -3, 0), (0, 3, 0), (-3, 3, 0))
    rectangle(scene, "Mirror", (0, -3, 0), (3, -3, 0), (3, 3, 0), (0, 3, 0),
              of=by_ray("Mirror", [rays], MIRROR, MIRROR))
    scene.camera.location, scene.camera.rotation_euler = (0, -6, 5), (0.88, 0, 0)
    scene.renderformer_v2.light = "NETWORK"
    assert_alike(*beside_cycles(scene, tmp_path), rtol=0.1, atol=0.01)


@pytest.mark.parametrize("node, output, rtol", [
    ("LayerWeight", "Facing", 0.3), ("LayerWeight", "Fresnel", 0.06), ("Fresnel", "Fac", 0.06)])
def test_light_bounces_off_what_depends_on_the_view_as_its_mean_says(scene, tmp_path, node, output, rtol):
    walls = material("Velvet")
    tree = walls.node_tree
    view, diffuse = tree.nodes.new(f"ShaderNode{node}"), tree.nodes.new("ShaderNodeBsdfDiffuse")
    if node == "Fresnel":
        view.inputs["IOR"].default_value = 3
    tree.links.new(view.outputs[output], diffuse.inputs["Color"])
    tree.links.new(diffuse.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    room(scene, floor=walls, left=walls, right=walls)
    lamp(scene)
    assert_alike(*beside_cycles(scene, tmp_path), rtol=rtol)
