# SPDX-License-Identifier: GPL-3.0-or-later
"""The generator takes the user's own panoramas, meshes and maps, and leaves out what it cannot use."""
import bpy
import numpy as np
import OpenEXR
import pytest

from tools.datagen.scenes import generator, materials, objects, own_data, worlds
from tools.datagen.scenes.objects import build_object
from tools.datagen.scenes.own_files import OWN_FILES, group_maps
from tools.datagen.scenes.worlds import ORDERS


@pytest.fixture(autouse=True)
def no_own_files():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    OWN_FILES.use_folders(None, None, None, 0.5)
    OWN_FILES.unusable.clear()
    yield
    OWN_FILES.use_folders(None, None, None, 0.5)


@pytest.fixture
def folder(tmp_path):
    """A panorama of one colour, two cubes in an OBJ file, a set of maps, and a file of each kind that is broken."""
    for name in ("hdris", "meshes", "textures"):
        (tmp_path / name).mkdir()
    light = np.tile(np.float32([4, 2, 1]), (32, 64, 1))
    with OpenEXR.File({"type": OpenEXR.scanlineimage}, {"RGB": light}) as file:
        file.write(str(tmp_path / "hdris" / "red.exr"))
    for x in (0, 3):
        bpy.ops.mesh.primitive_cube_add(location=(x, 0, 0))
    bpy.ops.wm.obj_export(filepath=str(tmp_path / "meshes" / "cubes.obj"))
    for name, value in {"brick_basecolor_2k": 0.8, "brick_roughness_2k": 0.3, "brick_normal_2k": 0.5}.items():
        picture = bpy.data.images.new(name, 1100, 550)
        picture.pixels.foreach_set(np.tile(np.float32([value, value, value, 1]), 1100 * 550))
        picture.save(filepath=str(tmp_path / "textures" / f"{name}.png"))
    for name in ("hdris/broken.hdr", "meshes/broken.obj", "textures/broken_color.png"):
        (tmp_path / name).write_text("nothing")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return tmp_path


def test_own_files_take_the_place_of_built_in_ones(folder, capsys):
    OWN_FILES.use_folders(folder / "hdris", folder / "meshes", folder / "textures", 1.0)
    assert len(OWN_FILES.panoramas) == len(OWN_FILES.meshes) == 2
    assert [set(maps) for maps in OWN_FILES.textures] == [{"base", "roughness", "normal"}, {"base"}]
    red, order = folder / "hdris" / "red.exr", "BRG"
    image, scale = own_data.load_panorama(red, order)
    assert tuple(image.size) == (512, 256) and scale == pytest.approx(3 / 7, rel=0.01)
    assert order in ORDERS and np.allclose(image.pixels[:3], (1, 4, 2), rtol=0.02)
    assert own_data.load_panorama(folder / "hdris" / "broken.hdr", order) is None

    (folder / "meshes" / "broken.obj").unlink()
    OWN_FILES.use_folders(None, folder / "meshes", None, 1.0)
    thing = build_object(np.random.default_rng(2), "thing", 500)
    sides = np.ptp([v.co for v in thing.data.vertices], axis=0)
    assert len(thing.data.vertices) == 16 and list(bpy.data.objects) == [thing] and max(sides) > 0.6
    (folder / "meshes" / "broken.obj").write_text("nothing")
    assert own_data.load_mesh(folder / "meshes" / "broken.obj") is None and list(bpy.data.objects) == [thing]

    OWN_FILES.use_folders(None, None, folder / "textures", 1.0)
    brick = OWN_FILES.textures[0] if len(OWN_FILES.textures[0]) == 3 else OWN_FILES.textures[1]
    maps = own_data.load_maps(brick)
    assert tuple(maps["base"].size) == (1024, 512) and maps["normal"].colorspace_settings.name == "Non-Color"
    assert own_data.load_maps({"base": folder / "textures" / "broken_color.png"}) is None
    said = capsys.readouterr().out
    assert all(said.count(name) == 1 for name in ("broken.hdr is left out", "broken.obj is left out",
                                                  "broken_color.png is left out"))


def save_cube(path, faces: int) -> None:
    """So many faces of a cube as OBJ, each with corners of its own, as glTF stores them."""
    bpy.ops.mesh.primitive_cube_add()
    cube = bpy.context.object.data
    corners = [cube.vertices[i].co[:] for face in cube.polygons[:faces] for i in face.vertices]
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    lines += ["f {} {} {} {}".format(*range(i, i + 4)) for i in range(1, len(corners), 4)]
    path.write_text("\n".join(lines))
    bpy.ops.wm.read_factory_settings(use_empty=True)


def test_meshes_that_are_not_watertight_are_left_out_unless_asked_for(tmp_path, capsys):
    whole, shell = tmp_path / "whole.obj", tmp_path / "shell.obj"
    save_cube(whole, 6)
    save_cube(shell, 5)
    assert len(own_data.load_mesh(whole).vertices) == 8
    assert own_data.load_mesh(shell) is None and own_data.load_mesh(shell) is None
    said = capsys.readouterr().out
    assert said.count(f"{shell} is left out: it is not watertight, 4 of its 12 edges") == 1 and str(whole) not in said
    OWN_FILES.use_folders(None, tmp_path, None, 1.0, open_meshes=True)
    assert len(own_data.load_mesh(shell).polygons) == 5


def test_a_scene_of_own_files_alone(folder):
    for name in ("hdris/broken.hdr", "meshes/broken.obj", "textures/broken_color.png"):
        (folder / name).unlink()
    OWN_FILES.use_folders(folder / "hdris", folder / "meshes", folder / "textures", 1.0)
    generator.build_scene((5, 0), "paper", 1, 2048)
    things = [thing for thing in bpy.data.objects if thing.name.startswith("object")]
    assert things and all(len(thing.data.polygons) % 6 == 0 for thing in things)  # cubes, subdivided
    linked = {node.image.name.partition("_")[0] for material in bpy.data.materials for node in material.node_tree.nodes
              if node.bl_idname == "ShaderNodeTexImage"}
    assert linked <= {"brick"}
    generator.clear_file()
    assert not [image for image in bpy.data.images if own_data.OWN in image]


def test_scenes_stay_as_they_were_without_own_files(folder):
    def points(seed: int) -> np.ndarray:
        generator.build_scene((seed, 0), "full", 1)
        return np.concatenate([np.array([v.co for v in thing.data.vertices]) for thing in bpy.data.objects
                               if thing.name.startswith("object")])

    before = points(4)
    OWN_FILES.use_folders(folder / "hdris", None, None, 0.0)
    np.testing.assert_array_equal(points(4), before)


@pytest.mark.parametrize("arguments, message", [
    (("hdris", None, None, 2.0), "--own 2: expected a number from 0 to 1"),
    ((None, "empty", None, 0.5), "--meshes .*empty holds no files of the kinds .obj"),
    ((None, None, "rough", 0.5), "--textures .*rough holds no base colours"),
])
def test_folders_of_no_use_are_named(folder, arguments, message):
    (folder / "empty").mkdir()
    (folder / "rough").mkdir()
    (folder / "rough" / "wood_roughness.png").touch()
    folders = [name and folder / name for name in arguments[:3]]
    with pytest.raises(ValueError, match=message):
        OWN_FILES.use_folders(*folders, arguments[3])


def test_names_of_maps_are_told_apart(tmp_path):
    names = ["wood_diff_1k.jpg", "wood_rough_1k.jpg", "wood_nor_gl_1k.exr", "wood_nor_dx_1k.exr", "wood_disp_1k.png",
             "photo.jpg", "sub/basecolor.png", "sub/metallic.png", "sub/height.png"]
    sets = group_maps([tmp_path / name for name in names])
    assert [{kind: str(path.relative_to(tmp_path)) for kind, path in maps.items()} for maps in sets] == [
        {"base": "wood_diff_1k.jpg", "roughness": "wood_rough_1k.jpg", "normal": "wood_nor_gl_1k.exr"},
        {"base": "photo.jpg"}, {"base": "sub/basecolor.png", "metallic": "sub/metallic.png"}]


def test_something_built_in_takes_the_place_of_files_that_cannot_be_used(folder):
    for path in folder.glob("*/*"):
        path.write_text("nothing")
    OWN_FILES.use_folders(folder / "hdris", folder / "meshes", folder / "textures", 1.0)
    rng = np.random.default_rng(3)
    assert len(objects.build_object(rng, "thing", 500).data.polygons) > 0
    material = materials.build_material(rng, "full", "object", "textured_metallic")
    assert any(node.bl_idname == "ShaderNodeTexImage" for node in material.node_tree.nodes)
    worlds.build_world(rng, "hdri", 1.0)
    assert bpy.context.scene.world.node_tree.nodes["Background"].inputs["Color"].is_linked
