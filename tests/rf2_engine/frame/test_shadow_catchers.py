# SPDX-License-Identifier: GPL-3.0-or-later
"""Shadow catchers show the shadows on them and nothing else, as in Cycles."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render

from tests.rf2_engine.f12 import cube, mesh_object, press_f12, sun
from tests.rf2_engine.still_life import with_cycles


@pytest.fixture
def product(scene):
    """A cube on a floor that catches its shadow, in the sun."""
    cube(scene, location=(0, 0, 0.3)).rotation_euler = (0, 0, 0.5)
    floor = mesh_object(scene, "Floor", [(-6, -4, -1), (6, -4, -1), (6, 8, -1), (-6, 8, -1)], [(0, 1, 2, 3)])
    floor.is_shadow_catcher = True
    sun(scene, rotation=(0.3, 0.7, 0))
    scene.camera.location, scene.camera.rotation_euler = (0, -6, 2), (1.25, 0, 0)
    scene.renderformer_v2.guide_samples = scene.cycles.samples = 8
    return scene


def instanced(scene):
    floor, collection = bpy.data.objects["Floor"], bpy.data.collections.new("Floors")
    scene.collection.objects.unlink(floor)
    collection.objects.link(floor)
    empty = bpy.data.objects.new("Floors", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", collection
    scene.collection.objects.link(empty)


@pytest.mark.parametrize("film_transparent, change", [(True, None), (False, None), (True, instanced)])
def test_shadows_are_those_of_cycles_and_objects_stay(product, tmp_path, film_transparent, change):
    if change:
        change(product)
    product.render.film_transparent = film_transparent
    ours = press_f12(product, tmp_path)["ViewLayer.Combined"]
    assert bpy.data.objects["Floor"].is_shadow_catcher and not bpy.data.objects["Floor"].is_holdout
    remarks = last_render.last_frame[0].remarks
    assert [remark.name for remark in remarks if "shadow catcher" in remark.message] == ["Floor"]
    product.cycles.samples, product.cycles.diffuse_bounces = 32, 0  # direct light, as the report says
    cycles = with_cycles(product, tmp_path)["ViewLayer.Combined"]
    assert np.abs(ours - cycles)[..., 3].mean() < 0.015
    bpy.data.objects["Floor"].hide_render = True
    product.render.film_transparent = True
    bare = with_cycles(product, tmp_path)["ViewLayer.Combined"][..., 3] == 0
    assert np.abs(ours - cycles)[bare].mean() < 0.015
    if film_transparent:
        assert ours[bare, :3].max() < 0.05  # at its far edge too the floor has no colour
    shadow = (ours[..., 3] if film_transparent else 1 - ours[..., :3].mean(axis=-1) / 0.25)[bare]
    assert shadow.max() > 0.5 and (shadow < 0.1).mean() > 0.3
    assert ours[18, 25, 3] == 1 and ours[18, 25, :3].min() > 0.05  # the cube


@pytest.mark.parametrize("film_transparent", [True, False])
def test_with_the_pass_shadows_are_in_it_and_not_in_the_picture(product, tmp_path, film_transparent):
    product.view_layers[0].cycles.use_pass_shadow_catcher = True
    product.render.film_transparent = film_transparent
    ours = press_f12(product, tmp_path)
    assert product.view_layers[0].cycles.use_pass_shadow_catcher
    product.cycles.samples, product.cycles.diffuse_bounces = 32, 0
    cycles = with_cycles(product, tmp_path)
    shadow, expected = ours["ViewLayer.Shadow Catcher"], cycles["ViewLayer.Shadow Catcher"]
    assert (expected < 0.5).mean() > 0.02
    assert np.abs(shadow - expected).clip(0, 1).mean() < 0.03
    product.render.film_transparent = True
    bare = with_cycles(product, tmp_path)["ViewLayer.Combined"][..., 3] == 0
    assert bare.mean() > 0.3
    assert np.abs(ours["ViewLayer.Combined"] - cycles["ViewLayer.Combined"])[bare].mean() < 0.02


def test_the_pass_is_one_where_nothing_catches(scene, tmp_path):
    cube(scene)
    scene.view_layers[0].cycles.use_pass_shadow_catcher = True
    assert (press_f12(scene, tmp_path)["ViewLayer.Shadow Catcher"] == 1).all()


def test_without_a_ray_to_a_light_they_are_shown_and_reported(product, tmp_path):
    product.renderformer_v2.light, product.render.film_transparent = "NETWORK", True
    assert press_f12(product, tmp_path)["ViewLayer.Combined"][35, 25, 3] == 1
    assert any("With Cycles" in line and "Floor" in line for line in last_render.last_frame[0].report)
