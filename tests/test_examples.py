# SPDX-License-Identifier: GPL-3.0-or-later
"""The scenes that the documentation names can be made."""
import bpy
import OpenEXR
import pytest

from examples import bounced, from_python, others


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


def test_a_scene_by_others_gets_a_camera_and_keeps_the_rest(tmp_path):
    package = tmp_path / "package" / "data" / "props"
    package.mkdir(parents=True)
    bpy.ops.wm.read_factory_settings()
    bpy.context.scene.camera = None
    kept = sorted(thing.name for thing in bpy.data.objects)
    bpy.ops.wm.save_as_mainfile(filepath=str(package / "kitchen_objects.blend"))
    others.prepare(tmp_path, "tableware", tmp_path)

    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "tableware.blend"))
    scene = bpy.context.scene
    assert scene.render.engine == "RENDERFORMER_V2" and scene.camera.name == "Added Camera"
    assert sorted(thing.name for thing in bpy.data.objects) == sorted([*kept, "Added Camera"])
    assert (scene.render.resolution_x, scene.render.resolution_y) == others.SCENES["tableware"].size


def test_a_package_that_is_not_there_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match="environments/sandbox.blend"):
        others.prepare(tmp_path, "sandbox", tmp_path)


def test_python_without_blender_makes_a_picture(tmp_path):
    from_python.main(str(tmp_path / "picture.exr"))
    with OpenEXR.File(str(tmp_path / "picture.exr")) as file:
        picture = file.channels()["RGB"].pixels
    assert picture.shape == (from_python.PIXELS, from_python.PIXELS, 3) and picture.max() == pytest.approx(12)
    (left, right), floor = picture[48:96, [8, -8]].mean(axis=0), picture[-8:, 48:80].mean(axis=(0, 1))
    assert left[0] > 2 * left[1] and right[1] > 2 * right[0] and 0.1 < floor.mean() < 2
