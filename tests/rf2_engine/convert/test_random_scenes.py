# SPDX-License-Identifier: GPL-3.0-or-later
"""Random scenes convert to finite tokens, or are refused in words; as in test_random_nodes.py."""
import bpy
import pytest

from tests.rf2_engine.convert.random_conversion import run_seeds
from tests.rf2_engine.convert.random_scenes import RandomScene

from . import random_nodes


@pytest.fixture
def build(scene):
    """Function that fills the scene anew."""
    types = random_nodes.node_types()

    def fill(rng):
        keep = {scene.camera, scene.camera.data, scene.world}
        scene.world = None
        scene.view_layers[0].material_override = None
        bpy.data.batch_remove([block for holder in (
            bpy.data.objects, bpy.data.meshes, bpy.data.lights, bpy.data.curves, bpy.data.metaballs, bpy.data.materials,
            bpy.data.worlds, bpy.data.collections, bpy.data.node_groups, bpy.data.particles, bpy.data.volumes)
            for block in holder if block not in keep])
        RandomScene(scene, rng, types)

    return fill


def test_some_random_scenes_convert(build):
    run_seeds(10, build)


@pytest.mark.slow
def test_many_random_scenes_convert(build):
    run_seeds(500, build, first=1000)
