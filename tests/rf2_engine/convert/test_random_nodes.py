# SPDX-License-Identifier: GPL-3.0-or-later
"""Random node trees of materials, lamps, volumes and worlds: they convert to finite tokens, whatever they hold.

RANDOM_SEED=1000 tries others than the usual ones; a failure names the seeds that it needs.
"""
import bpy
import numpy as np
import pytest

from tests.rf2_engine.convert.random_conversion import run_seeds

from . import random_nodes

UV = np.tile([(0, 0), (1, 0), (0.3, 1)], (4, 1))


@pytest.fixture
def things(scene, add_mesh):
    """What the trees may name: images, an object, a mesh with UVs and colours; and the kinds of nodes there are."""
    rock = add_mesh("Rock", [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], [(0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)])
    rock.data.uv_layers.new(name="UVMap").data.foreach_set("uv", UV.ravel())
    colors = rock.data.color_attributes.new("Color", "FLOAT_COLOR", "CORNER")
    colors.data.foreach_set("color", np.linspace(0, 2, 48))
    bpy.data.images.new("Painted", 8, 8)
    bpy.data.images.new("Bright", 4, 2, float_buffer=True)
    bpy.data.images.new("Lost", 4, 4).filepath = "//lost.png"
    bpy.data.images["Lost"].source = "FILE"
    rock.data.materials.append(bpy.data.materials.new("Random"))
    rock.active_material.use_nodes = True
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "AREA"))
    lamp.location.z = 3
    lamp.data.use_nodes = True
    scene.collection.objects.link(lamp)
    scene.view_layers[0].update()
    return scene, random_nodes.node_types()


def of_a_material(scene, types):
    def build(rng):
        _forget_groups()
        random_nodes.fill_with_output(bpy.data.materials["Random"].node_tree, rng, types)
        scene.world = None
        if rng.random() < 0.2:
            random_nodes.fill_with_output(bpy.data.lights["Lamp"].node_tree, rng, types, "ShaderNodeOutputLight")
    return build


def of_a_world(scene, types):
    def build(rng):
        _forget_groups()
        scene.world = bpy.data.worlds["Grey"]
        random_nodes.fill_with_output(scene.world.node_tree, rng, types, "ShaderNodeOutputWorld")
    return build


def _forget_groups():
    for holder in (bpy.data.materials["Random"], bpy.data.lights["Lamp"], bpy.data.worlds["Grey"]):
        holder.node_tree.nodes.clear()
    bpy.data.batch_remove(bpy.data.node_groups)


@pytest.mark.parametrize("build, count", [(of_a_material, 10), pytest.param(of_a_world, 1, marks=pytest.mark.slow)])
def test_some_random_trees_convert(things, build, count):
    run_seeds(count, build(*things))


@pytest.mark.slow
@pytest.mark.parametrize("build, count", [(of_a_material, 500), (of_a_world, 100)])
def test_many_random_trees_convert(things, build, count):
    run_seeds(count, build(*things), first=1000)
