# SPDX-License-Identifier: GPL-3.0-or-later
"""The scenes that the documentation names can be made."""
import bpy
import pytest

from examples import bounced


@pytest.mark.parametrize("build", bounced.ROOMS, ids=lambda build: build.__name__)
def test_a_room_has_a_camera_and_some_light(build):
    build()
    scene = bpy.context.scene
    assert scene.camera is not None and scene.render.resolution_x == bounced.SIZE
    lamps = [thing for thing in scene.objects if thing.type == "LIGHT"]
    sky = max(scene.world.node_tree.nodes["Background"].inputs["Color"].default_value[:3])
    shining = [m for m in bpy.data.materials if m.node_tree.nodes.get("Principled BSDF")
               and m.node_tree.nodes["Principled BSDF"].inputs["Emission Strength"].default_value > 0]
    assert lamps or sky > 0 or shining
    assert len([thing for thing in scene.objects if thing.type == "MESH"]) >= 6
