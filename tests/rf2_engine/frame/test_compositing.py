# SPDX-License-Identifier: GPL-3.0-or-later
"""Graphs of Blender's compositor do with our passes what they do with those of Cycles."""
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.pictures import linear_to_srgb

from tests.rf2_engine.f12 import press_f12
from tests.rf2_engine.still_life import composite_into, compositor, tick, with_cycles

SIZE = 96, 72


def composited(found):
    """What the graph made of the picture, (H, W, 4)."""
    return found["Composite.Combined"]


@pytest.fixture
def pictured(still_life):
    still_life.render.resolution_x, still_life.render.resolution_y = SIZE
    still_life.renderformer_v2.guide_samples = still_life.cycles.samples = 8
    return still_life


@pytest.mark.parametrize("name", ["Cycles Reference", "Cycles Diffuse Direct"])
def test_the_reference_is_there_for_the_compositor(lit, tmp_path, name):
    lit.renderformer_v2.reference.use_light_passes = True
    layers = compositor(lit).nodes.new("CompositorNodeRLayers")
    layers.scene = lit
    composite_into(lit, layers.outputs[name])
    found = press_f12(lit, tmp_path)
    np.testing.assert_array_equal(composited(found)[..., :3], found[f"ViewLayer.{name}"][..., :3])
    assert composited(found)[..., :3].max() > 0.1


@pytest.mark.parametrize("of, name", [("Object", "Moving"), *(
    pytest.param(*of, marks=pytest.mark.slow) for of in (("Material", "Shining"), ("Asset", "Moving")))])
def test_the_matte_of_an_object_is_that_of_cycles(pictured, tmp_path, of, name):
    layer = pictured.view_layers[0]
    setattr(layer, f"use_pass_cryptomatte_{of.lower()}", True)
    tree = compositor(pictured)
    node = tree.nodes.new("CompositorNodeCryptomatteV2")
    node.scene, node.layer_name, node.matte_id = pictured, f"{layer.name}.Crypto{of}", name
    composite_into(pictured, node.outputs["Matte"])
    ours = composited(press_f12(pictured, tmp_path))[..., 0]
    cycles = composited(with_cycles(pictured, tmp_path))[..., 0]
    assert 0.02 < (cycles > 0.5).mean() < 0.5
    np.testing.assert_allclose(ours, cycles, atol=1e-4)


def test_denoise_glare_and_defocus_make_nearly_what_they_make_of_cycles(pictured, tmp_path):
    tick(pictured.view_layers[0], {"depth", "denoising_albedo"})
    pictured.cycles.use_denoising = True
    tree = compositor(pictured)
    layers = tree.nodes.new("CompositorNodeRLayers")
    layers.scene = pictured
    denoise, glare, defocus = (tree.nodes.new(f"CompositorNode{name}") for name in ("Denoise", "Glare", "Defocus"))
    tree.links.new(layers.outputs["Noisy Image"], denoise.inputs["Image"])
    tree.links.new(layers.outputs["Denoising Albedo"], denoise.inputs["Albedo"])
    tree.links.new(layers.outputs["Denoising Normal"], denoise.inputs["Normal"])
    tree.links.new(denoise.outputs["Image"], glare.inputs["Image"])
    tree.links.new(glare.outputs["Image"], defocus.inputs["Image"])
    tree.links.new(layers.outputs["Depth"], defocus.inputs["Z"])
    defocus.use_zbuffer, defocus.scene, defocus.f_stop = True, pictured, 0.5
    pictured.camera.data.dof.focus_distance = 2
    composite_into(pictured, defocus.outputs["Image"])
    found = press_f12(pictured, tmp_path)
    ours, plain = composited(found), found["ViewLayer.Combined"]
    pictured.cycles.samples = 64
    cycles = composited(with_cycles(pictured, tmp_path))
    assert np.isfinite(ours).all() and np.abs(ours - plain).mean() > 1e-3  # it does something
    error = linear_to_srgb(ours[..., :3]) - linear_to_srgb(cycles[..., :3])
    assert -10 * np.log10((error ** 2).mean()) > 25
