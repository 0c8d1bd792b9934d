# SPDX-License-Identifier: GPL-3.0-or-later
"""Passes of light groups: each like Cycles', together the picture, and free where there are none."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine import compat
from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render

from tests.rf2_engine.f12 import cube, material, mesh_object, press_f12, sun
from tests.rf2_engine.frame.test_stereo import passes_of as stereo_passes
from tests.rf2_engine.still_life import with_cycles

GROUPS = "Key", "Bulb", "Sky"


@pytest.fixture
def grouped(scene):
    """A cube on a floor before a wall, lit by a lamp, a sphere that glows and the world; each has its light group."""
    floor = [(-4, -4, -1), (4, -4, -1), (4, 3, -1), (-4, 3, -1)]
    mesh_object(scene, "Floor", floor, [(0, 1, 2, 3)], material("Red", (0.8, 0.3, 0.2)))
    mesh_object(scene, "Wall", [(-4, 3, -1), (4, 3, -1), (4, 3, 4), (-4, 3, 4)], [(0, 1, 2, 3)])
    cube(scene, location=(-0.8, 1, 0)).scale = (0.6, 0.6, 1)
    glowing = material("Glowing")
    glowing.node_tree.nodes["Principled BSDF"].inputs["Emission Color"].default_value = (1, 0.6, 0.2, 1)
    glowing.node_tree.nodes["Principled BSDF"].inputs["Emission Strength"].default_value = 12
    bulb = cube(scene, "Bulb", (1.4, 1, -0.4), glowing)
    bulb.scale = (0.25, 0.25, 0.25)
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    lamp.data.energy, lamp.data.shadow_soft_size, lamp.location = 250, 0.2, (2, -2, 2.5)
    scene.collection.objects.link(lamp)
    for name in GROUPS:
        scene.view_layers[0].lightgroups.add(name=name)
    lamp.lightgroup, bulb.lightgroup, scene.world.lightgroup = GROUPS
    scene.camera.location, scene.camera.rotation_euler = (0, -6, 1), (1.42, 0, 0)
    scene.renderformer_v2.guide_samples = 8
    return scene


def passes_of(found):
    return {name: found[f"ViewLayer.Combined_{name}"] for name in GROUPS}


def combined(found):
    return found["ViewLayer.Combined"][..., :3]


@pytest.mark.parametrize("light", ["TRACED", "NETWORK"])
def test_each_group_is_like_that_of_cycles_and_all_are_the_picture(grouped, tmp_path, light):
    grouped.renderformer_v2.light, grouped.cycles.film_exposure = light, 2
    found = press_f12(grouped, tmp_path)
    assert last_render.last_frame[0].error == ""
    ours = passes_of(found)
    np.testing.assert_allclose(sum(ours.values()), combined(found), rtol=1e-3, atol=1e-4)
    grouped.cycles.samples, grouped.cycles.use_denoising, grouped.cycles.sample_clamp_indirect = 256, False, 0
    theirs = passes_of(with_cycles(grouped, tmp_path))
    for name in GROUPS:
        error = np.abs(ours[name] - theirs[name]).mean() / theirs[name].mean()
        assert error < 0.2, name


def focused(scene):
    lens = scene.camera.data.dof
    lens.use_dof, lens.focus_distance, lens.aperture_fstop = True, 5, 0.2
    scene.renderformer_v2.lens_samples = 4


def cut(scene):
    bpy.data.objects["Cube"].is_holdout = True


def cut_by_material(scene):
    tree = bpy.data.objects["Cube"].data.materials[0].node_tree
    tree.links.new(tree.nodes.new("ShaderNodeHoldout").outputs[0], tree.nodes["Material Output"].inputs["Surface"])


def seen_by_two(scene):
    scene.render.use_multiview, scene.render.views_format = True, "STEREO_3D"
    scene.camera.data.stereo.interocular_distance, scene.camera.data.stereo.convergence_distance = 0.6, 6


@pytest.mark.parametrize("change", [
    focused, cut, pytest.param(cut_by_material, marks=pytest.mark.slow), seen_by_two])
def test_groups_are_those_of_cycles_in_every_view_behind_a_lens_and_around_holdouts(grouped, tmp_path, change):
    change(grouped)
    ours = stereo_passes(grouped, tmp_path)
    assert last_render.last_frame[0].error == ""
    grouped.render.engine = "CYCLES"
    grouped.cycles.samples, grouped.cycles.use_denoising, grouped.cycles.sample_clamp_indirect = 256, False, 0
    theirs = stereo_passes(grouped, tmp_path)
    views = ("", ".left", ".right") if change is seen_by_two else ("",)
    views = [view for view in views if f"ViewLayer.Combined{view}" in ours]
    assert len(views) == (2 if change is seen_by_two else 1)
    for view in views:
        names = [f"ViewLayer.Combined_{name}{view}" for name in GROUPS]
        picture = ours[f"ViewLayer.Combined{view}"][..., :3]
        np.testing.assert_allclose(sum(ours[name] for name in names), picture, rtol=1e-3, atol=1e-4)
        for name in names:
            assert np.abs(ours[name] - theirs[name]).mean() < 0.2 * theirs[name].mean(), name


def test_lights_of_no_group_are_in_no_pass(grouped, tmp_path):
    grouped.render.film_transparent = True
    bpy.data.objects["Lamp"].lightgroup = "Elsewhere"
    sun(grouped)
    found = press_f12(grouped, tmp_path)
    ours = passes_of(found)
    assert (ours["Key"] == 0).all()
    rest = combined(found) - sum(ours.values())
    assert rest.min() > -1e-4 and rest.mean() > 0.2 * combined(found).mean()
    assert ours["Sky"][found["ViewLayer.Combined"][..., 3] == 0].sum() == 0


def test_without_groups_the_picture_and_the_stages_are_the_same(grouped, tmp_path):
    with_groups = combined(press_f12(grouped, tmp_path))
    assert "Light groups" in last_render.last_frame[0].seconds
    for _ in GROUPS:
        bpy.ops.scene.view_layer_remove_lightgroup()
    found = press_f12(grouped, tmp_path)
    np.testing.assert_array_equal(combined(found), with_groups)
    assert "Light groups" not in last_render.last_frame[0].seconds
    assert not any("Combined_" in name for name in found)


@pytest.mark.slow
def test_the_mixer_recombines_the_picture_without_a_render(grouped, tmp_path):
    plain = combined(press_f12(grouped, tmp_path))
    assert bpy.ops.renderformer_v2.add_light_group_mixer() == {"FINISHED"}
    tree = compat.compositor(grouped)
    mixer = next(node for node in tree.nodes if node.bl_idname == "CompositorNodeGroup")
    assert [socket.name for socket in mixer.inputs if socket.is_linked] == ["Image", *GROUPS]
    found = press_f12(grouped, tmp_path)
    ours = passes_of(found)
    np.testing.assert_allclose(composite(found), plain, rtol=1e-3, atol=1e-4)
    mixer.inputs["Key Strength"].default_value = 0
    mixer.inputs["Sky Color"].default_value = (2, 0, 1, 1)
    expected = plain - ours["Key"] + ours["Sky"] * (1, -1, 0)
    np.testing.assert_allclose(composite(press_f12(grouped, tmp_path)), expected, rtol=1e-3, atol=1e-3)


def composite(found):
    return found["Composite.Combined"][..., :3]
