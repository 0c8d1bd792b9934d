# SPDX-License-Identifier: GPL-3.0-or-later
"""What the film is behind glass: transparent where Cycles has it so."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.cycles import session as cycles_session
from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render

from tests.rf2_engine.f12 import cube, material, mesh_object, press_f12, sun, volume_material
from tests.rf2_engine.still_life import with_cycles


@pytest.fixture
def behind_glass(scene):
    """A pane of glass over half of a cube, before nothing, on a transparent film."""
    cube(scene)
    sun(scene)
    glass = material("Glass")
    inputs = glass.node_tree.nodes["Principled BSDF"].inputs
    inputs["Transmission Weight"].default_value, inputs["Roughness"].default_value = 1, 0
    mesh_object(scene, "Pane", [(0.2, -3, -2), (3, -3, -2), (3, -3, 2), (0.2, -3, 2)], [(0, 1, 2, 3)], glass)
    scene.render.film_transparent = scene.cycles.film_transparent_glass = True
    scene.renderformer_v2.guide_samples = scene.cycles.samples = 8
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
    return scene


def test_transparent_glass_is_that_of_cycles(behind_glass, tmp_path):
    ours = press_f12(behind_glass, tmp_path)["ViewLayer.Combined"]
    cycles = with_cycles(behind_glass, tmp_path)["ViewLayer.Combined"]
    assert np.abs(ours - cycles)[..., 3].mean() < 0.01
    bare = (cycles[..., 3] < 0.2) & (np.arange(50) > 30)  # behind the pane there is nothing
    assert bare.sum() > 40 and np.abs(ours - cycles)[bare, :3].mean() < 0.05


def holdout_material():
    made = material("Cut")
    tree = made.node_tree
    tree.links.new(tree.nodes.new("ShaderNodeHoldout").outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    return made


@pytest.mark.parametrize("by_material", [False, True])
def test_a_holdout_in_fog_has_the_edge_that_it_has_in_cycles(scene, tmp_path, by_material):
    cube(scene, "Fog", of=volume_material("Fog", "VolumeScatter", {"Density": 0.08})).scale = (8, 8, 8)
    cube(scene, "Cut", (0.8, 0, 0), holdout_material() if by_material else None).is_holdout = not by_material
    mesh_object(scene, "Wall", [(-9, 2, -9), (9, 2, -9), (9, 2, 9), (-9, 2, 9)], [(0, 1, 2, 3)])
    sun(scene)
    scene.render.film_transparent = True
    scene.renderformer_v2.guide_samples, scene.cycles.samples = 16, 128
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
    ours, cycles = (picture["ViewLayer.Combined"][..., 3] for picture in (
        press_f12(scene, tmp_path), with_cycles(scene, tmp_path)))
    assert cycles.min() < 0.45 and (cycles > 0.99).mean() > 0.3
    assert (np.abs(ours - cycles) > 0.15).mean() < 0.01


@pytest.mark.parametrize("change", ["no glass", "network alone"])
def test_transparent_glass_costs_a_second_run_of_cycles_only_where_it_acts(behind_glass, tmp_path, monkeypatch, change):
    runs = []

    def render_views(engine, depsgraph, options, report, real=cycles_session.render_views):
        runs.append(options)
        return real(engine, depsgraph, options, report)
    monkeypatch.setattr(cycles_session, "render_views", render_views)
    if change == "no glass":
        bpy.data.objects.remove(bpy.data.objects["Pane"])
    else:
        behind_glass.renderformer_v2.light = "NETWORK"
    press_f12(behind_glass, tmp_path)
    assert len(runs) == 1
    assert any("behind glass" in line for line in last_render.last_frame[0].report) == (change == "network alone")
