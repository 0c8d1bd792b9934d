# SPDX-License-Identifier: GPL-3.0-or-later
"""A conversion reads Blender's data first: what it computes then needs neither them nor Blender's thread."""
import ast
import contextvars
import threading
from dataclasses import fields
from pathlib import Path

import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.normalize import Normalization
from bl_ext.user_default.renderformer_v2.rf2_engine.convert import compute as computing
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.camera.camera import convert_camera
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.compute import compute
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.copying.scene import copy
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.copied import ConversionOptions
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.report import Report
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.scene import convert
from bl_ext.user_default.renderformer_v2.rf2_engine.cycles.bake import UnavailableBaker

from tests.rf2_engine.convert.cycles_reference import lamp, material, world
from tests.sources import ROOT

LUMINAIRE = "IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 3 1 1 1 0 0 0 1 1 0\n0 45 90\n0\n1000 500 0\n"
OPTIONS = ConversionOptions(3000, 0.2)


def painted(name, size=8):
    image = bpy.data.images.new(name, size, size // 2, float_buffer=True)
    image.pixels.foreach_set(np.random.default_rng(0).uniform(0.1, 1, 2 * size * size).astype(np.float32))
    return image


def colored(tree, socket):
    """An image through ramp, curves and a group, at the coordinates of an object."""
    image, ramp, curves, at, group = (tree.nodes.new("ShaderNode" + kind) for kind in (
        "TexImage", "ValToRGB", "RGBCurve", "TexCoord", "Group"))
    image.image, at.object = painted("Painted"), bpy.data.objects["Lamp"]
    curves.mapping.curves[0].points.new(0.4, 0.7)
    group.node_tree = inner = bpy.data.node_groups.new("Inner", "ShaderNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        inner.interface.new_socket("Color", in_out=direction, socket_type="NodeSocketColor")
    begin, noise, mix, end = (inner.nodes.new(kind) for kind in (
        "NodeGroupInput", "ShaderNodeTexVoronoi", "ShaderNodeMixRGB", "NodeGroupOutput"))
    for links, first, second in (
            (tree, at.outputs["Object"], image.inputs["Vector"]), (tree, image.outputs["Color"], ramp.inputs[0]),
            (tree, ramp.outputs["Color"], curves.inputs["Color"]), (tree, curves.outputs[0], group.inputs[0]),
            (tree, group.outputs[0], socket), (inner, begin.outputs[0], mix.inputs["Color1"]),
            (inner, noise.outputs["Color"], mix.inputs["Color2"]), (inner, mix.outputs[0], end.inputs[0])):
        links.links.new(first, second)


@pytest.fixture
def rich(scene, add_mesh):
    """Textures, groups, displacement, instances of one mesh, a lamp with a profile, a volume and a panorama."""
    of_world, tree, background = world()
    sky = tree.nodes.new("ShaderNodeTexEnvironment")
    sky.image = painted("Panorama", 32)
    tree.links.new(sky.outputs[0], background.inputs["Color"])
    shone = lamp("POINT", np.eye(4), energy=50, use_nodes=True)
    shone.location = (1, -2, 3)
    luminaire = shone.data.node_tree.nodes.new("ShaderNodeTexIES")
    luminaire.ies = bpy.data.texts.new("Luminaire")
    luminaire.ies.write(LUMINAIRE)
    shone.data.node_tree.links.new(luminaire.outputs[0], shone.data.node_tree.nodes["Emission"].inputs["Strength"])
    stone, tree, shader = material(name="Stone")
    colored(tree, shader.inputs["Base Color"])
    moved = tree.nodes.new("ShaderNodeDisplacement")
    tree.links.new(tree.nodes.new("ShaderNodeTexNoise").outputs[0], moved.inputs["Height"])
    tree.links.new(moved.outputs[0], tree.get_output_node("CYCLES").inputs["Displacement"])
    stone.displacement_method = "DISPLACEMENT"
    told, tree, shader = material(name="Told", Emission_Strength=0.2)
    tree.links.new(tree.nodes.new("ShaderNodeObjectInfo").outputs["Random"], shader.inputs["Roughness"])
    smoke, tree, volume = material("ShaderNodeVolumePrincipled", "Smoke", Density=0.4)
    tree.links.new(volume.outputs[0], tree.get_output_node("CYCLES").inputs["Volume"])
    tree.links.remove(tree.get_output_node("CYCLES").inputs["Surface"].links[0])
    for i, made in enumerate((stone, told, smoke)):
        bpy.ops.mesh.primitive_cube_add(size=1, location=(1.5 * i - 1.5, 0, 0))
        bpy.context.object.data.materials.append(made)
    other = bpy.data.objects.new("Other", bpy.data.objects["Cube.001"].data)
    scene.collection.objects.link(other)
    other.location = (0, 1, 1.5)
    return scene


def emptied():
    """Takes away what the conversion has read."""
    bpy.data.batch_remove([block for holder in (
        bpy.data.objects, bpy.data.meshes, bpy.data.lights, bpy.data.materials, bpy.data.worlds, bpy.data.node_groups,
        bpy.data.images, bpy.data.texts) for block in holder])
    bpy.context.view_layer.update()


def on_another_thread(function):
    found = []
    context = contextvars.copy_context()
    thread = threading.Thread(target=lambda: found.append(context.run(function)))
    thread.start()
    thread.join()
    return found[0]


def assert_identical(first, second):
    for field in fields(first):
        one, two = getattr(first, field.name), getattr(second, field.name)
        if one is not None and not isinstance(one, np.ndarray):
            assert_identical(one, two)
        else:
            np.testing.assert_array_equal(one, two, err_msg=field.name)


def test_another_thread_computes_the_same_after_all_data_are_gone(rich):
    depsgraph, reports = bpy.context.evaluated_depsgraph_get(), (Report(), Report())
    view = convert_camera(depsgraph, 64, 48, None)
    expected = convert(depsgraph, view, OPTIONS, reports[0])
    assert len(expected.tiles) > 30 and expected.volumes and expected.environment is not None
    assert expected.is_light.any() and not np.isnan(Normalization.of(expected).scale)
    copied = copy(depsgraph, reports[1])
    emptied()
    for _ in range(2):
        assert_identical(on_another_thread(lambda: compute(copied, view, OPTIONS, reports[1])), expected)
    assert sorted(reports[0].lines()) == sorted(reports[1].lines())


def imported(path: Path) -> tuple[set[str], set[Path]]:
    """Packages that a file imports absolutely, and files of the add-on that it imports."""
    packages, files = set(), set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            packages |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            packages.add(node.module.split(".")[0])
        elif isinstance(node, ast.ImportFrom):
            folder = path.parents[node.level - 1].joinpath(*(node.module or "").split("."))
            places = [folder, *(folder / alias.name for alias in node.names)]
            files |= {file for place in places for file in (place.with_suffix(".py"), place / "__init__.py")
                      if file.exists()}
    return packages, files


def test_nothing_that_computes_imports_bpy():
    start = ROOT / Path(computing.__file__).relative_to(Path(computing.__file__).parents[2])
    waiting, seen, found = [start], set(), {}
    while waiting:
        path = waiting.pop()
        if path not in seen:
            seen.add(path)
            packages, files = imported(path)
            if "bpy" in packages:
                found[path] = packages
            waiting += files
    names = {path.relative_to(ROOT).as_posix() for path in seen}
    assert {"rf2_engine/convert/shading/surface.py", "rf2_engine/convert/media/volumes.py", "model/scene.py"} <= names
    assert not found
    assert "bpy" in imported(ROOT / "rf2_engine/compat.py")[0]


def test_images_that_show_nowhere_are_not_read(scene, add_mesh, tmp_path):
    made, tree, shader = material()
    images = []
    for name in ("Shown", "Unlinked"):
        image = painted(name)
        image.filepath_raw, image.file_format = str(tmp_path / f"{name}.exr"), "OPEN_EXR"
        image.save()
        images.append(bpy.data.images.load(image.filepath_raw))
        tree.nodes.new("ShaderNodeTexImage").image = images[-1]
    tree.links.new(tree.nodes["Image Texture"].outputs[0], shader.inputs["Base Color"])
    add_mesh("Rock", materials=[made])
    copy(bpy.context.evaluated_depsgraph_get(), Report())
    assert [image.has_data for image in images] == [True, False]


class Ready(UnavailableBaker):
    """Says whether it was made ready."""

    ready = False

    def prepare(self):
        self.ready = True


@pytest.mark.parametrize("kind", ["AmbientOcclusion", "TexNoise"])
def test_what_bakes_is_made_ready_where_a_material_needs_it(scene, add_mesh, kind):
    made, tree, shader = material()
    tree.links.new(tree.nodes.new("ShaderNode" + kind).outputs["Color"], shader.inputs["Base Color"])
    add_mesh("Rock", materials=[made])
    baker = Ready()
    copy(bpy.context.evaluated_depsgraph_get(), Report(), baker=baker)
    assert baker.ready == (kind == "AmbientOcclusion")


@pytest.mark.parametrize("of", ["world", "lamp"])
def test_sequences_show_the_frame_of_the_scene_that_is_converted(scene, tmp_path, of):
    """And not that of the scene in the window."""
    for number in (1, 2):
        image = bpy.data.images.new("Frame", 4, 4)
        image.generated_color = (0, number - 1, 1, 1)
        image.filepath_raw, image.file_format = str(tmp_path / f"frame_{number}.png"), "PNG"
        image.save()
    other = bpy.data.scenes.new("Other")
    if of == "world":
        made, tree, shader = world()
        texture = tree.nodes.new("ShaderNodeTexEnvironment")
        other.world = made
    else:
        shone = lamp("POINT", np.eye(4), energy=50, use_nodes=True)
        tree = shone.data.node_tree
        shader, texture = tree.nodes["Emission"], tree.nodes.new("ShaderNodeTexImage")
        other.collection.objects.link(shone)
    texture.image = bpy.data.images.load(str(tmp_path / "frame_1.png"))
    texture.image.source, texture.image_user.frame_duration = "SEQUENCE", 2
    tree.links.new(texture.outputs["Color"], shader.inputs["Color"])
    scene.frame_set(1)
    other.frame_set(2)
    depsgraph = other.view_layers[0].depsgraph
    depsgraph.update()
    found = convert(depsgraph, None, OPTIONS, Report())
    light = found.environment[0, 0] if of == "world" else found.emission.max(axis=0)
    assert light[1] == light[2] > 0
