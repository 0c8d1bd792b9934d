# SPDX-License-Identifier: GPL-3.0-or-later
"""Light passes of a guided network: colour x light, summed, plus emission, environment and volumes is the picture."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.model.renderer import EncodedScene
from bl_ext.user_default.renderformer_v2.rf2_engine import passes
from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render
from bl_ext.user_default.renderformer_v2.rf2_engine.setup import published_weights

from tests.model.published.bundles import tiny_published_config, write_bundle
from tests.rf2_engine.f12 import cube, material, mesh_object, press_f12, sun, volume_material
from tests.rf2_engine.still_life import tick, with_cycles

LOBES = ("diffuse", "glossy", "transmission")
OF_THE_RECIPE = passes.LIGHTING | {f"{lobe}_color" for lobe in LOBES} | {"emission", "environment"}


def by_key(found, layer="ViewLayer"):
    return {p.key: found[f"{layer}.{p.blender_name}"] for p in passes.PASSES if f"{layer}.{p.blender_name}" in found}


def recipe(found):
    """What the manual of Cycles says the compositor should do."""
    light = sum(found[f"{lobe}_color"] * (found[f"{lobe}_direct"] + found[f"{lobe}_indirect"]) for lobe in LOBES)
    volume = found["volume_direct"] + found["volume_indirect"]
    return light + volume + found["emission"] + found["environment"]


def assert_recipe_holds(found):
    np.testing.assert_allclose(recipe(found), found["combined"][..., :3], atol=2e-5, rtol=1e-4)
    halved = {key: pixels.astype(np.float16).astype(np.float32) for key, pixels in found.items() if pixels.max() < 1e4}
    np.testing.assert_allclose(recipe(halved), found["combined"][..., :3], atol=2e-3, rtol=4e-3)


@pytest.fixture
def asked(still_life):
    tick(still_life.view_layers[0], OF_THE_RECIPE)
    return still_life


@pytest.mark.parametrize("light", ["TRACED", "NETWORK"])
def test_the_recipe_of_cycles_gives_the_picture(asked, tmp_path, light):
    asked.renderformer_v2.light = light
    asked.cycles.film_exposure = 2
    found = by_key(press_f12(asked, tmp_path))
    assert_recipe_holds(found)
    lit = {"diffuse_direct", "glossy_direct", "diffuse_indirect", "transmission_indirect"}
    assert all(found[key].max() > 0.01 for key in lit)
    assert not found["volume_direct"].any()
    assert "Pass VolumeDir" not in {remark.name for remark in last_render.last_frame[0].remarks}
    colors = sum(found[f"{lobe}_color"] for lobe in LOBES)
    assert found["volume_indirect"][colors.min(-1) > 0.01].max() < 1e-3  # there is no volume


@pytest.mark.parametrize("transparent", [False, True])
def test_the_recipe_holds_for_every_view_layer_and_film_inside_a_border(asked, tmp_path, transparent):
    settings, second = asked.render, asked.view_layers.new("Second")
    tick(second, {p.key for p in passes.PASSES})
    second.material_override = material("Clay", (0.6, 0.5, 0.4))
    asked.objects["Moving"].is_holdout = True
    settings.film_transparent, settings.use_border, settings.use_crop_to_border = transparent, True, transparent
    settings.border_min_x, settings.border_max_x, settings.border_min_y, settings.border_max_y = 0.11, 0.87, 0.08, 0.9
    found = press_f12(asked, tmp_path)
    layers = [by_key(found, layer) for layer in ("ViewLayer", "Second")]
    for of in layers:
        of["environment"] *= not transparent  # whose film does not show it
        assert_recipe_holds(of)
        assert of["diffuse_direct"].max() > 0.01 and of["combined"][..., 3].min() < 0.5
    assert not np.array_equal(*(of["combined"] for of in layers))


@pytest.mark.parametrize("transparent", [False, True])
def test_of_shadow_catchers_the_passes_have_what_those_of_cycles_have(asked, tmp_path, transparent):
    asked.objects["Floor"].is_shadow_catcher, asked.render.film_transparent = True, transparent
    found = by_key(press_f12(asked, tmp_path))
    shadows = recipe(found) - found["combined"][..., :3] - (found["environment"] if transparent else 0)
    if transparent:  # but for what the denoiser takes from emitters beside them
        assert (np.abs(shadows) < 1e-4).mean() > 0.99 and np.abs(shadows).mean() < 1e-3
    else:  # the world behind them is without their shadows there
        assert shadows.min() > -2e-3 and shadows.max() > 0.01 and (shadows.max(-1) < 1e-3).mean() > 0.3
    asked.cycles.diffuse_bounces = 0
    cycles = by_key(with_cycles(asked, tmp_path))
    np.testing.assert_allclose(found["environment"], cycles["environment"], atol=1e-3)
    np.testing.assert_allclose(found["emission"], cycles["emission"], atol=1e-3)
    is_dark = cycles["diffuse_direct"].max(-1) == 0
    assert (is_dark & (cycles["diffuse_color"].max(-1) > 0.1)).mean() > 0.1  # the floor
    assert found["diffuse_direct"][is_dark].mean() < 0.01
    assert found["diffuse_direct"].mean() == pytest.approx(cycles["diffuse_direct"].mean(), rel=0.1)


def test_the_picture_does_not_depend_on_what_is_asked(asked, tmp_path):
    with_light = press_f12(asked, tmp_path)["ViewLayer.Combined"]
    for p in passes.PASSES:
        if p.source == "lighting" and "." not in p.setting:
            setattr(asked.view_layers[0], p.setting, False)
    asked.view_layers[0].cycles.use_pass_volume_direct = asked.view_layers[0].cycles.use_pass_volume_indirect = False
    found = press_f12(asked, tmp_path)
    np.testing.assert_allclose(found["ViewLayer.Combined"], with_light, atol=1e-5)
    assert not passes.LIGHTING & set(by_key(found))


def test_traced_light_goes_to_the_lobes_that_cycles_finds(asked, tmp_path):
    """Direct light is denoised, so it is compared with many samples of Cycles."""
    ours = by_key(press_f12(asked, tmp_path))
    asked.cycles.samples = 256
    cycles = by_key(with_cycles(asked, tmp_path))
    for key in ("diffuse_direct", "glossy_direct"):
        color = ours[key.replace("direct", "color")]
        error = np.abs(color * (ours[key] - cycles[key])).mean()
        assert error < 0.25 * (color * cycles[key]).mean(), key


def test_a_polished_floor_divides_what_a_wall_sends_to_it_as_in_cycles(scene, tmp_path):
    """Of a dark floor Cycles chooses more paths by the glossy lobe than by the diffuse one."""
    dark = material("Dark", (0.08, 0.08, 0.08))
    dark.node_tree.nodes["Principled BSDF"].inputs["Roughness"].default_value = 0.6
    mesh_object(scene, "Floor", [(-4, -3, -1), (4, -3, -1), (4, 2, -1), (-4, 2, -1)], [(0, 1, 2, 3)], dark)
    mesh_object(scene, "Wall", [(-4, 2, -1), (4, 2, -1), (4, 2, 4), (-4, 2, 4)], [(0, 1, 2, 3)])
    sun(scene, (1.2, 0, 0))
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)
    scene.renderformer_v2.guide_samples, scene.cycles.samples, scene.cycles.sample_clamp_indirect = 64, 256, 0
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
    tick(scene.view_layers[0], OF_THE_RECIPE)
    ours, cycles = by_key(press_f12(scene, tmp_path)), by_key(with_cycles(scene, tmp_path))
    for lobe in "diffuse", "glossy":
        own, expected = ((of[f"{lobe}_color"] * of[f"{lobe}_indirect"])[30:].mean() for of in (ours, cycles))
        assert own == pytest.approx(expected, rel=0.12) and expected > 1e-3, lobe


@pytest.mark.parametrize("ticked", [{"diffuse_direct"}, {"diffuse_direct", "glossy_indirect", "volume_direct"}])
def test_a_file_has_the_light_passes_that_are_ticked_and_no_others(asked, tmp_path, ticked):
    whole = by_key(press_f12(asked, tmp_path))
    for key in passes.LIGHTING - ticked:
        untick(asked.view_layers[0], key)
    found = by_key(press_f12(asked, tmp_path))
    assert passes.LIGHTING & set(found) == ticked
    np.testing.assert_allclose(found["combined"], whole["combined"], atol=1e-5)
    for key in ticked - {"volume_direct"}:
        color = whole[key.replace("indirect", "color").replace("direct", "color")]
        assert np.abs(color * (found[key] - whole[key])).mean() < 0.1 * (color * whole[key]).mean() > 0, key


def test_volume_indirect_needs_all_light(asked, tmp_path):
    for key in passes.LIGHTING - {"volume_indirect"}:
        untick(asked.view_layers[0], key)
    assert_recipe_holds(by_key(press_f12(asked, tmp_path)))


def untick(layer, key):
    owner, _, name = next(p.setting for p in passes.PASSES if p.key == key).rpartition(".")
    setattr(getattr(layer, owner) if owner else layer, name, False)


def test_light_in_a_volume_is_in_the_volume_passes(scene, tmp_path):
    cube(scene, of=volume_material("Fog", "VolumePrincipled", {"Density": 0.6}))
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    lamp.data.energy, lamp.location = 500, (2, -3, 2)
    scene.collection.objects.link(lamp)
    tick(scene.view_layers[0], OF_THE_RECIPE)
    found = by_key(press_f12(scene, tmp_path))
    assert_recipe_holds(found)
    assert found["volume_direct"][15:22, 20:30].mean() > 0.01
    assert last_render.last_frame[0].error == ""


def test_a_picture_of_the_world_alone_has_dark_light(scene, tmp_path):
    tick(scene.view_layers[0], OF_THE_RECIPE)
    found = by_key(press_f12(scene, tmp_path))
    assert_recipe_holds(found)
    assert all((found[key] == 0).all() for key in passes.LIGHTING)


def test_the_published_network_draws_edges_alone_and_gives_no_light(still_life, tmp_path, monkeypatch):
    drawn = []

    def view(encoded, *given, real=EncodedScene.view):
        drawn.append(real(encoded, *given))
        return drawn[-1]
    monkeypatch.setattr(EncodedScene, "view", view)
    folder = write_bundle(tmp_path / "renderformer-v2", tiny_published_config())
    still_life.renderformer_v2.weights_source, still_life.renderformer_v2.weights_folder = "FOLDER", str(folder)
    tick(still_life.view_layers[0], OF_THE_RECIPE)
    found = by_key(press_f12(still_life, tmp_path))
    assert not passes.LIGHTING & set(found)
    assert "Encoding textures" in last_render.last_frame[0].seconds and published_weights.latents_file().is_file()
    expected = drawn[0] + found["emission"] + found["environment"]
    np.testing.assert_allclose(found["combined"][..., :3], expected, rtol=1e-5, atol=1e-6)
