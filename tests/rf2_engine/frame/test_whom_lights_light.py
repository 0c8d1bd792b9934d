# SPDX-License-Identifier: GPL-3.0-or-later
"""Whom a light lights, on which rays it is seen and how often it bounces: also after it has bounced, beside Cycles."""
import bpy
import pytest

from tests.rf2_engine.f12 import cube
from tests.rf2_engine.rooms import assert_alike, beside_cycles, lamp, room


def world_hidden(scene, light):
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.5, 0.7, 1, 1)
    scene.world.cycles_visibility.diffuse = False


def lamp_hidden(scene, light):
    light.visible_diffuse = False
    lamp(scene, (1, 0, 2.5), (0, 0.4, 0), 50)


def lamp_seen_in_no_gloss(scene, light):
    light.visible_glossy = False


def mesh_hidden(scene, light):
    shining = cube(scene, "Shining", (1, 0, 1.2))
    shining.scale = (0.4,) * 3
    inputs = shining.data.materials[0].node_tree.nodes["Principled BSDF"].inputs
    inputs["Emission Color"].default_value, inputs["Emission Strength"].default_value = (1, 0.4, 0.1, 1), 5
    shining.visible_diffuse = False


def lamp_bouncing(most):
    def change(scene, light):
        light.data.cycles.max_bounces = most
    return change


def sun_that_does_not_bounce(scene, light):
    light.data.cycles.max_bounces = 0
    lamp(scene, turn=(-0.9, 0.3, 0), energy=2, kind="SUN").data.cycles.max_bounces = 0


def lamp_without_shadows(scene, light):
    cube(scene, "Near", (0, 0, 1.2)).scale = (0.5, 0.5, 0.2)
    light.data.use_shadow = False


def bounces(**settings):
    def change(scene, light):
        for name, value in settings.items():
            setattr(scene.cycles, f"{name}_bounces", value)
    return change


def linked(state):
    def change(scene, light):
        receivers = bpy.data.collections.new("Receivers")
        receivers.objects.link(scene.objects["right"])
        light.light_linking.receiver_collection = receivers
        receivers.collection_objects[0].light_linking.link_state = state
        lamp(scene, (1, 0, 2.5), (0, 0.4, 0), 20)
    return change


def shaded_by(state):
    def change(scene, light):
        for name, x in (("Near", -0.5), ("Far", 0.7)):
            cube(scene, name, (x, 0, 1.2)).scale = (0.1, 0.5, 0.5)
        blockers = bpy.data.collections.new("Blockers")
        blockers.objects.link(scene.objects["Near"])
        light.light_linking.blocker_collection = blockers
        blockers.collection_objects[0].light_linking.link_state = state
    return change


CHANGES = {
    "the world is hidden from diffuse rays": world_hidden,
    "a lamp is hidden from diffuse rays": lamp_hidden,
    "a lamp is hidden from glossy rays": lamp_seen_in_no_gloss,
    "a shining mesh is hidden from diffuse rays": mesh_hidden,
    "a lamp's light does not bounce": lamp_bouncing(0),
    "a lamp's light bounces once": lamp_bouncing(1),
    "a sun's light does not bounce": sun_that_does_not_bounce,
    "no light bounces": bounces(max=0),
    "no light bounces diffusely": bounces(diffuse=0),
    "light bounces once": bounces(diffuse=1),
    "light bounces eight times": bounces(diffuse=8),
    "a lamp lights one wall alone": linked("INCLUDE"),
    "a lamp lights all but one wall": linked("EXCLUDE"),
    "one thing alone is in the way of a lamp's light": shaded_by("INCLUDE"),
    "one thing is not in the way of a lamp's light": shaded_by("EXCLUDE"),
    "nothing is in the way of a lamp's light": lamp_without_shadows,
}


@pytest.mark.parametrize("change, light", [
    pytest.param(change, light, marks=pytest.mark.slow if (i + j) % 2 else ())
    for i, change in enumerate(CHANGES) for j, light in enumerate(("TRACED", "NETWORK"))])
def test_light_goes_where_it_goes_in_cycles(scene, tmp_path, change, light):
    room(scene)
    CHANGES[change](scene, lamp(scene))
    scene.renderformer_v2.light = light
    ours, cycles = beside_cycles(scene, tmp_path)
    assert_alike(ours, cycles, *((0.1, 0.004) if light == "TRACED" else (0.15, 0.015)))
