# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials at the pixels of a picture against Cycles' Diffuse Color and Normal passes, on meshes that were simplified.

One picture of nine objects in a row of three, each in a cell of its own.
"""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.first_hits.camera_rays import CENTER, SPREAD, cast_guides
from bl_ext.user_default.renderformer_v2.model.geometry import unit
from bl_ext.user_default.renderformer_v2.model.metrics.scores import psnr
from bl_ext.user_default.renderformer_v2.rf2_engine import compat
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.camera.camera import convert_camera
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.compute import compute
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.copying.scene import copy
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.copied import ConversionOptions
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.report import Report
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.shading.hit_materials import HitMaterials

from tests.rf2_engine.convert.cycles_reference import empty_cycles_scene, material
from tests.rf2_engine.f12 import read_exr

CELL, SIDE, TEXELS = 64, 3, 64
BUDGET = 900  # triangles, of thousands


def image(name, pixels, space="sRGB"):
    made = bpy.data.images.new(name, TEXELS, TEXELS)
    made.colorspace_settings.name = space
    made.pixels.foreach_set(np.dstack([pixels, np.ones((TEXELS, TEXELS))]).astype(np.float32).ravel())
    made.pack()
    return made


def waves():
    y, x = np.mgrid[:TEXELS, :TEXELS] / TEXELS
    return np.dstack([0.5 + 0.4 * np.sin(40 * x), 0.5 + 0.4 * np.sin(30 * y), (8 * x).astype(int) % 2])


def linked(tree, kind, target, output=0, **settings):
    """A node that feeds an input."""
    node = tree.nodes.new(kind)
    for key, value in settings.items():
        if isinstance(value, float):
            node.inputs[key].default_value = value
        else:
            setattr(node, key, value)
    tree.links.new(node.outputs[output], target)
    return node


def checker(tree, color, _):
    node = linked(tree, "ShaderNodeTexChecker", color, Scale=24.0)
    linked(tree, "ShaderNodeUVMap", node.inputs["Vector"], uv_map="UVMap")


def fine_checker(tree, color, _):
    node = linked(tree, "ShaderNodeTexChecker", color, Scale=90.0)
    linked(tree, "ShaderNodeUVMap", node.inputs["Vector"], uv_map="UVMap")


def picture(tree, color, _):
    linked(tree, "ShaderNodeTexImage", color, image=image("Waves", waves()))


def second_layer(tree, color, _):
    node = linked(tree, "ShaderNodeTexImage", color, image=image("Waves", waves()))
    linked(tree, "ShaderNodeUVMap", node.inputs["Vector"], uv_map="Turned")


def vertex_color(tree, color, _):
    linked(tree, "ShaderNodeVertexColor", color, layer_name="Paint")


def random_color(tree, color, _):
    linked(tree, "ShaderNodeObjectInfo", color, "Random")


def voronoi(tree, color, _):
    linked(tree, "ShaderNodeTexVoronoi", color, "Color", Scale=9.0)


def bump(tree, _, normal):
    node = linked(tree, "ShaderNodeBump", normal, Distance=0.05)
    linked(tree, "ShaderNodeTexNoise", node.inputs["Height"], Scale=4.0, Detail=0.0)


def normal_map(tree, _, normal):
    y, x = np.mgrid[:TEXELS, :TEXELS] / TEXELS
    slopes = np.dstack([0.5 + 0.2 * np.sin(25 * x), 0.5 + 0.2 * np.sin(25 * y), np.full_like(x, 0.9)])
    node = linked(tree, "ShaderNodeNormalMap", normal)
    linked(tree, "ShaderNodeTexImage", node.inputs["Color"], image=image("Slopes", slopes, "Non-Color"))


COLORS = checker, fine_checker, picture, second_layer, vertex_color, random_color, voronoi
NORMALS = bump, normal_map
CASES = COLORS + NORMALS


def tile(case):
    row, column = divmod(CASES.index(case), SIDE)
    return np.s_[CELL * row:CELL * (row + 1), CELL * column:CELL * (column + 1)]


def dome(name):
    """A finely divided dish with two UV layers and colours."""
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=40, y_subdivisions=40, size=1.8)
    obj = bpy.context.object
    obj.name, mesh = name, obj.data
    places = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", places)
    places = places.reshape(-1, 3)
    places[:, 2] = 0.25 * np.cos(2 * places[:, 0]) * np.cos(1.5 * places[:, 1])
    mesh.vertices.foreach_set("co", places.ravel())
    mesh.polygons.foreach_set("use_smooth", np.ones(len(mesh.polygons), bool))
    uv = np.empty(2 * len(mesh.loops), np.float32)
    mesh.uv_layers[0].data.foreach_get("uv", uv)
    mesh.uv_layers.new(name="Turned").data.foreach_set("uv", 1 - uv.reshape(-1, 2)[:, ::-1].ravel())
    paint = np.random.default_rng(0).uniform(0.1, 0.9, (len(mesh.vertices), 4)).astype(np.float32)
    mesh.color_attributes.new("Paint", "FLOAT_COLOR", "POINT").data.foreach_set("color", paint.ravel())
    return obj


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    """Our guides with several rays through each pixel and with one, and Cycles' two passes."""
    scene = empty_cycles_scene(samples=16)
    scene.render.resolution_x = scene.render.resolution_y = SIDE * CELL
    for i, case in enumerate(CASES):
        made, tree, shader = material("ShaderNodeBsdfDiffuse", case.__name__)
        case(tree, shader.inputs["Color"], shader.inputs["Normal"])
        row, column = divmod(i, SIDE)
        obj = dome(case.__name__)
        obj.location = 2 * (column - 1), 2 * (1 - row), 0
        obj.data.materials.append(made)
        if case is random_color:  # four instances of one mesh
            obj.scale = 0.45, 0.45, 0.45
            for x, y in ((-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)):
                copy_of_it = obj.copy()
                copy_of_it.location = obj.location[0] + x, obj.location[1] + y, 0
                scene.collection.objects.link(copy_of_it)
            bpy.data.objects.remove(obj)
    data = bpy.data.cameras.new("Camera")
    data.lens, data.sensor_width = 100, 6
    camera = bpy.data.objects.new("Camera", data)
    camera.location = 0, 0, 100
    scene.collection.objects.link(camera)
    scene.camera = camera
    bpy.context.view_layer.update()
    passes = cycles_passes(scene, tmp_path_factory.mktemp("passes"))
    depsgraph = bpy.context.evaluated_depsgraph_get()
    view, report, hit_materials = convert_camera(depsgraph, SIDE * CELL, SIDE * CELL, None), Report(), HitMaterials()
    converted = compute(copy(depsgraph, report), view, ConversionOptions(BUDGET, 1.0), report,
                        hit_materials=hit_materials)
    assert len(converted) <= BUDGET < len(converted.surfaces)
    return {positions: cast_guides(converted, view, positions, hit_materials) for positions in (SPREAD, CENTER)}, passes


NAMES = {"DiffCol": ("DiffCol", "Diffuse Color"), "Normal": "Normal"}  # the second from Blender 5.0 on


def cycles_passes(scene, folder) -> dict[str, np.ndarray]:
    """Diffuse Color as scenes have it, and Normal of one sample in the middle of each pixel."""
    layer, passes = bpy.context.view_layer, {}
    layer.use_pass_diffuse_color = layer.use_pass_normal = True
    compat.set_file_format(scene.render.image_settings, "OPEN_EXR_MULTILAYER")
    for name, samples, width in (("DiffCol", 128, 1.5), ("Normal", 1, 0.01)):
        scene.cycles.samples, scene.cycles.filter_width = samples, width
        scene.render.filepath = str(folder / f"{name}.exr")
        bpy.ops.render.render(write_still=True)
        found = read_exr(scene.render.filepath)
        passes[name] = next(pixels for key, pixels in found.items() if key.endswith(NAMES[name]))
    return passes


@pytest.mark.parametrize("case", COLORS, ids=lambda case: case.__name__)
def test_colors_at_pixels_are_those_of_cycles(seen, case):
    guides, passes = seen
    ours, cycles = guides[SPREAD].diffuse_color[tile(case)], passes["DiffCol"][tile(case)][..., :3]
    assert np.ptp(cycles) > 0.1
    assert psnr(ours, cycles) > 28


@pytest.mark.parametrize("case", NORMALS, ids=lambda case: case.__name__)
def test_normals_at_pixels_are_those_of_cycles(seen, case):
    guides, passes = seen
    inside = tile(case)
    ours, cycles = guides[CENTER].normal[inside], unit(passes["Normal"][inside])
    both = (guides[CENTER].alpha[inside] > 0) & (passes["Normal"][inside] != 0).any(axis=-1)
    apart = np.degrees(np.arccos((ours * cycles).sum(-1).clip(-1, 1)))[both]
    assert both.sum() > 2000 and np.degrees(np.arccos(cycles[..., 2][both])).max() > 20
    assert np.median(apart) < 1 and np.percentile(apart, 90) < 3
