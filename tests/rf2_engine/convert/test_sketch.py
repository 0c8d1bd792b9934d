# SPDX-License-Identifier: GPL-3.0-or-later
"""Unlit pictures show surfaces where they are, in the colours of their materials."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.camera import view_rays
from bl_ext.user_default.renderformer_v2.model.first_hits.camera_rays import cast_guides
from bl_ext.user_default.renderformer_v2.rf2_engine.convert import sketch as sketches
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.camera.camera import convert_camera
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.copying.scene import copy
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.copied import ConversionOptions
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.report import Report
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.scene import convert
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.sketch import Sketch

from tests.rf2_engine.f12 import cube, material, mesh_object
from tests.rf2_engine.viewport.views import depsgraph

WIDTH, HEIGHT = 96, 64


def sketch(reads_images=True, before=None):
    return Sketch(copy(depsgraph(), Report(), reads_images=reads_images), before)


def picture(transparent=True, **how):
    return sketch(**how).picture(*view_rays(convert_camera(depsgraph(), WIDTH, HEIGHT, None, Report())), transparent)


def test_surfaces_are_where_the_conversion_puts_them(scene):
    cube(scene, of=material("Red", (0.8, 0.05, 0.05))).rotation_euler = (0.3, 0.2, 0.5)
    cube(scene, "Hidden", (1, 0, 1)).visible_camera = False
    view = convert_camera(depsgraph(), WIDTH, HEIGHT, None, Report())
    guides = cast_guides(convert(depsgraph(), view, ConversionOptions(2048, 0.1), Report()), view)
    shown = picture()
    assert 0.05 < shown[..., 3].mean() < 0.95
    np.testing.assert_array_equal(shown[..., 3] > 0, guides.alpha > 0)
    red = shown[shown[..., 3] > 0]
    np.testing.assert_allclose(red[:, 0], 16 * red[:, 1], rtol=1e-3)


def test_nothing_is_dark_grey_in_an_opaque_film(scene):
    shown = picture(transparent=False)
    np.testing.assert_allclose(shown, np.broadcast_to((*[sketches.BACKGROUND] * 3, 1), shown.shape))


def test_textures_are_shown_once_they_are_read(scene):
    image = bpy.data.images.new("Green", 2, 2)
    image.pixels.foreach_set(np.tile((0.0, 1.0, 0.0, 1.0), 4).astype(np.float32))
    of = material("Textured")
    node = of.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    of.node_tree.links.new(node.outputs["Color"], of.node_tree.nodes["Principled BSDF"].inputs["Base Color"])
    cube(scene, of=of)
    read, unread = picture(), picture(reads_images=False)
    assert read[..., 1].max() > 0.3 and not read[..., 0].any()
    assert unread[..., 1].max() > 0.2
    np.testing.assert_allclose(unread[..., 0], unread[..., 1])


def test_what_is_clear_shows_what_is_behind_it(scene):
    clear = material("Clear")
    tree = clear.node_tree
    tree.links.new(tree.nodes.new("ShaderNodeBsdfTransparent").outputs[0],
                   tree.nodes["Material Output"].inputs["Surface"])
    cube(scene, of=material("Blue", (0.0, 0.0, 0.8)))
    bare = picture()
    pane = mesh_object(scene, "Pane", [(-9, -2, -9), (9, -2, -9), (9, -2, 9), (-9, -2, 9)], [(0, 1, 2, 3)], clear)
    behind = picture()
    covered = bare[..., 3] > 0
    np.testing.assert_allclose(behind[covered], bare[covered], atol=1e-3)
    pane.data.materials[0] = None
    assert picture()[..., 3].all()


def test_of_a_fine_mesh_a_sample_covers_about_as_much(scene, monkeypatch):
    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32)
    whole = picture()[..., 3]
    monkeypatch.setattr(sketches, "MOST", 1000)
    some = sketch()
    assert len(some.triangles) < 1200 and abs(picture()[..., 3].mean() - whole.mean()) < 0.2 * whole.mean()


def test_another_copy_of_the_same_surfaces_shares_their_tree(scene):
    moved = cube(scene)
    copied = copy(depsgraph(), Report())
    first = Sketch(copied)
    assert Sketch(copied, first)._surfaces is first._surfaces
    moved.location.x = 0.5
    bpy.context.view_layer.update()
    assert Sketch(copy(depsgraph(), Report()), first)._surfaces is not first._surfaces


@pytest.mark.parametrize("slots", [0, 1])
def test_empty_meshes_and_slots_have_no_surprises(scene, slots):
    mesh_object(scene, "Empty", [], [])
    bare = cube(scene)
    bare.data.materials.clear()
    for _ in range(slots):
        bare.data.materials.append(None)
    assert picture()[..., 3].any()
