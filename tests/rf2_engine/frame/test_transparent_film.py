# SPDX-License-Identifier: GPL-3.0-or-later
"""A transparent film with light groups and with holdouts: passes add up, and alpha and light are Cycles'."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render

from tests.rf2_engine.f12 import material, mesh_object, press_f12
from tests.rf2_engine.frame.test_light_groups import combined, cut, cut_by_material, grouped, passes_of
from tests.rf2_engine.still_life import with_cycles

__all__ = "grouped",


@pytest.fixture
def clear(grouped):
    """A film that is transparent above the wall and beside it."""
    grouped.render.film_transparent = True
    grouped.camera.location, grouped.camera.rotation_euler = (0, -11, 2.5), (1.45, 0, 0)
    return grouped


def nothing(scene):
    pass


def cut_by_collection(scene):
    """The cube is in a collection that is a holdout of the view layer."""
    collection = bpy.data.collections.new("Cut")
    scene.collection.children.link(collection)
    collection.objects.link(bpy.data.objects["Cube"])
    scene.collection.objects.unlink(bpy.data.objects["Cube"])
    scene.view_layers[0].layer_collection.children["Cut"].holdout = True


def through_glass(scene):
    """A pane of smooth glass stands before the wall and the sky, whose alpha shows through it with traced light."""
    glass = material("Glass", (1, 1, 1))
    glass.node_tree.nodes["Principled BSDF"].inputs["Transmission Weight"].default_value = 1
    glass.node_tree.nodes["Principled BSDF"].inputs["Roughness"].default_value = 0
    mesh_object(scene, "Pane", [(-3, -6, 2), (-1, -6, 2), (-1, -6, 9), (-3, -6, 9)], [(0, 1, 2, 3)], glass)
    scene.cycles.film_transparent_glass = True


def inside(mask):
    """The pixels whose neighbours are in the mask, up to two pixels away: edges are smoothed."""
    height, width = mask.shape
    padded = np.pad(mask, 2, mode="edge")
    return np.all([padded[y:y + height, x:x + width] for y in range(5) for x in range(5)], axis=0)


def beside_cycles(scene, tmp_path):
    """What a user finds of ours, and of Cycles with many samples."""
    ours = press_f12(scene, tmp_path)
    assert last_render.last_frame[0].error == ""
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.sample_clamp_indirect = 256, False, 0
    return ours, with_cycles(scene, tmp_path)


QUICK = (nothing, "TRACED"), (nothing, "TRANSFORMER"), (cut, "TRACED"), (cut_by_material, "NETWORK")


@pytest.mark.parametrize("change, light", [
    pytest.param(change, light, marks=[] if (change, light) in QUICK else pytest.mark.slow)
    for change in (nothing, cut, cut_by_material, cut_by_collection, through_glass)
    for light in ("TRACED", "NETWORK", "TRANSFORMER") if change is not through_glass or light == "TRACED"])
def test_groups_add_up_to_the_picture_and_all_is_as_in_cycles(clear, tmp_path, change, light):
    change(clear)
    clear.renderformer_v2.light = light
    ours, theirs = beside_cycles(clear, tmp_path)
    np.testing.assert_allclose(sum(passes_of(ours).values()), combined(ours), rtol=1e-3, atol=1e-4)
    alpha, expected = (found["ViewLayer.Combined"][..., 3] for found in (ours, theirs))
    assert np.abs(alpha - expected).mean() < 0.01 and (expected == 0).any()
    for value in (0, 1):
        np.testing.assert_allclose(alpha[inside(expected == value)], value, atol=1e-3)
    assert not combined(ours)[alpha == 0].any()  # premultiplied
    if light != "TRANSFORMER":
        assert np.abs(combined(ours) - combined(theirs)).mean() < 0.12 * combined(theirs).mean()
        for name, group in passes_of(ours).items():
            in_cycles = passes_of(theirs)[name]
            assert np.abs(group - in_cycles).mean() < 0.2 * in_cycles.mean(), name
