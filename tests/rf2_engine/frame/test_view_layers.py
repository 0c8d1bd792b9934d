# SPDX-License-Identifier: GPL-3.0-or-later
"""What a view layer leaves out, replaces or cuts out is so in our passes and our alpha as in those of Cycles."""
import os

import bpy
import numpy as np
import pytest
from scipy import ndimage

from bl_ext.user_default.renderformer_v2.rf2_engine import passes
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.copying import vdb
from bl_ext.user_default.renderformer_v2.rf2_engine.cycles import session as cycles_session
from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render

from tests.rf2_engine.f12 import material, press_f12
from tests.rf2_engine.still_life import tick, with_cycles

FIRST_HITS = {p.key for p in passes.PASSES if p.source == "guide"}


def collection_of(scene, name):
    """The object `name`, alone in a collection; the collection's place in the view layer."""
    made = bpy.data.collections.new(name)
    scene.collection.children.link(made)
    scene.collection.objects.unlink(bpy.data.objects[name])
    made.objects.link(bpy.data.objects[name])
    return scene.view_layers[0].layer_collection.children[name]


def material_override(scene, layer):
    layer.material_override = material("Blue", (0.05, 0.1, 0.9))


def excluded(scene, layer):
    collection_of(scene, "Lantern").exclude = True


def holdout(scene, layer):
    collection_of(scene, "Moving").holdout = True


def holdout_of_an_object(scene, layer):
    bpy.data.objects["Moving"].is_holdout = True


def indirect_only(scene, layer):
    collection_of(scene, "Floor").indirect_only = True


def no_sky(scene, layer):
    layer.use_sky = False


def no_solid(scene, layer):
    layer.use_solid = False


def no_volumes(scene, layer):
    openvdb = vdb.openvdb_module()
    grid = openvdb.FloatGrid(0.0)
    grid.copyFromArray(np.ones((8, 8, 8), np.float32))
    grid.name = "density"
    openvdb.write(os.path.join(bpy.app.tempdir, "smoke.vdb"), [grid])
    smoke = bpy.data.volumes.new("Smoke")
    smoke.filepath = os.path.join(bpy.app.tempdir, "smoke.vdb")
    scene.collection.objects.link(bpy.data.objects.new("Smoke", smoke))
    layer.use_volumes = False


def holdout_of_a_material(scene, layer):
    tree = material("Hole").node_tree
    tree.links.new(tree.nodes.new("ShaderNodeHoldout").outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    bpy.data.objects["Moving"].active_material = bpy.data.materials["Hole"]


CHANGES = (material_override, excluded, indirect_only, no_sky, no_solid, no_volumes, holdout, holdout_of_an_object,
           holdout_of_a_material)


@pytest.mark.parametrize("change, film_transparent", [
    pytest.param(change, transparent, marks=pytest.mark.slow if (i + transparent) % 2 else ())
    for i, change in enumerate(CHANGES) for transparent in (False, True)])
def test_passes_and_alpha_are_those_of_cycles(still_life, tmp_path, change, film_transparent):
    layer = still_life.view_layers[0]
    change(still_life, layer)
    still_life.render.film_transparent = film_transparent
    tick(layer, FIRST_HITS)
    ours = press_f12(still_life, tmp_path)
    cycles = with_cycles(still_life, tmp_path)
    assert set(ours) - {"ViewLayer.Noisy Image"} == set(cycles)
    smooth = {f"ViewLayer.{p.blender_name}" for p in passes.PASSES if p.key in ("emission", "environment")}
    for name in set(cycles) - {"ViewLayer.Combined"} - smooth:
        same = np.isclose(ours[name], cycles[name], rtol=1e-4, atol=1e-5).all(-1)
        assert same.mean() > 0.999, name
    of_cycles = np.dstack([*(cycles[name] for name in sorted(smooth)), cycles["ViewLayer.Combined"][..., 3:]])
    of_ours = np.dstack([*(ours[name] for name in sorted(smooth)), ours["ViewLayer.Combined"][..., 3:]])
    np.testing.assert_allclose(of_ours.mean((0, 1)), of_cycles.mean((0, 1)), rtol=0.03, atol=1e-3)
    edges = ndimage.maximum_filter(of_cycles, (9, 9, 1)) - ndimage.minimum_filter(of_cycles, (9, 9, 1))
    flat = edges.max(-1) < 1e-4
    np.testing.assert_allclose(of_ours[flat], of_cycles[flat], atol=1e-4)


def test_a_view_layer_has_its_own_samples_and_its_name_may_be_too_long_for_files(scene, tmp_path, monkeypatch):
    taken = []

    def render_views(engine, depsgraph, options, report, real=cycles_session.render_views):
        taken.append(options.sampling.most)
        return real(engine, depsgraph, options, report)
    monkeypatch.setattr(cycles_session, "render_views", render_views)
    second = scene.view_layers.new("n" * 60)
    second.renderformer_v2.samples = 3
    press_f12(scene, tmp_path)
    assert taken == [1, 3]
    first, second = (layer.report for layer in last_render.last_frame)
    assert not any("letters" in line for line in first) and any("letters" in line for line in second)
