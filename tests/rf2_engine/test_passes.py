# SPDX-License-Identifier: GPL-3.0-or-later
"""Passes of first hits are those of Cycles, by name and by pixel, and the file says whose mattes they are."""
import bpy
import numpy as np
import OpenEXR
import pytest

import cycles.engine as cycles_engine
from bl_ext.user_default.renderformer_v2.model.published.bundle_files import TRANSFORMERS
from bl_ext.user_default.renderformer_v2.rf2_engine import passes
from bl_ext.user_default.renderformer_v2.rf2_engine.frame_settings import light_passes
from bl_ext.user_default.renderformer_v2.rf2_engine.panels import view_layer
from bl_ext.user_default.renderformer_v2.rf2_engine.setup import published_weights

from tests.model.published.bundles import tiny_published_config, write_bundle
from tests.rf2_engine.f12 import press_f12
from tests.rf2_engine.still_life import compositor, tick, tick_own, with_cycles

COMMON = {p.key for p in passes.PASSES if p.source in ("guide", "data")} - {"sample_count"}  # 1 everywhere


@pytest.mark.parametrize("light", ["TRACED", "NETWORK"])
def test_first_hits_are_those_of_a_cycles_render(still_life, tmp_path, light):
    layer = still_life.view_layers[0]
    still_life.renderformer_v2.light = light
    still_life.cycles.film_exposure = 1.5
    tick(layer, COMMON)
    tick_own(layer)
    ours = press_f12(still_life, tmp_path)
    cycles = with_cycles(still_life, tmp_path)
    assert {"ViewLayer.CryptoObject00", "ViewLayer.CryptoMaterial00", "ViewLayer.CryptoAsset00", "ViewLayer.Tint",
            "ViewLayer.Wear", "ViewLayer.Vector"} <= set(cycles) == set(ours) - {"ViewLayer.Noisy Image"}
    for name in set(cycles) - {"ViewLayer.Combined"}:
        assert np.ptp(cycles[name]) > 0 or name.endswith(("01", "02", "Specular Albedo")), f"{name} says nothing"
        if passes.pass_key(name.removeprefix("ViewLayer.")) in ("emission", "environment"):
            continue  # smoothed as Combined is: test_view_layers.py
        same = np.isclose(ours[name], cycles[name], rtol=1e-4, atol=1e-5).all(-1)
        assert same.mean() > (0.6 if name.endswith(("AO", "Occlusion")) else 0.999), name  # AO: other random numbers
        assert ours[name].mean() == pytest.approx(cycles[name].mean(), rel=0.02), name


@pytest.mark.parametrize("light", ["TRACED", pytest.param("NETWORK", marks=pytest.mark.slow)])
def test_vectors_of_kept_scenes_leave_the_scene_as_it_was(still_life, tmp_path, light):
    """Cycles goes to the frames before and after for them, and evaluates the scene anew."""
    still_life.renderformer_v2.light, still_life.render.use_persistent_data = light, True
    floor = still_life.objects["Floor"]
    for frame in (1, 3):
        still_life.cycles.samples, still_life.renderformer_v2.guide_samples = 10 * frame, frame
        still_life.cycles.keyframe_insert("samples", frame=frame)
        still_life.renderformer_v2.keyframe_insert("guide_samples", frame=frame)
        floor.visible_shadow = frame == 1
        floor.keyframe_insert("visible_shadow", frame=frame)
    tick(still_life.view_layers[0], COMMON)
    still_life.frame_start, still_life.frame_end = 1, 3
    still_life.render.filepath = str(tmp_path / "frame_")
    bpy.ops.render.render(animation=True, scene=still_life.name)
    assert len(list(tmp_path.iterdir())) == 3
    still_life.frame_set(2)
    cycles = still_life.cycles
    assert (cycles.samples, cycles.max_bounces, cycles.use_denoising) == (20, 12, False) and floor.visible_diffuse
    assert with_cycles(still_life, tmp_path)["ViewLayer.Combined"][..., :3].mean() > 0.1


def test_names_channels_and_sockets_are_those_of_cycles(still_life):
    """Before the first render."""
    layer, still_life.cycles.use_denoising = still_life.view_layers[0], True
    tick(layer, COMMON | passes.LIGHTING)
    tick_own(layer)
    theirs = set(cycles_engine.list_render_passes(still_life, layer))
    ours = {(p.blender_name, p.channels, p.kind) for p in passes.ticked_passes(layer, passes.LIGHTING)}
    assert ours == theirs
    assert sockets(still_life) == {name for name, *_ in theirs} - {"Combined"} | {"Image", "Alpha"}


def sockets(scene):
    """Names of the outputs that the Render Layers node of the compositor shows."""
    tree = compositor(scene)
    node = tree.nodes.new("CompositorNodeRLayers")
    node.scene = scene
    scene.view_layers[0].update_render_passes()
    return {s.name for s in node.outputs if s.enabled and not s.is_unavailable}


def test_cryptomattes_come_with_what_readers_need(still_life, tmp_path):
    tick_own(still_life.view_layers[0])
    press_f12(still_life, tmp_path)
    with OpenEXR.File(str(tmp_path / "picture.exr")) as file:
        header = dict(file.header())
    names = {value: key.split("/")[1] for key, value in header.items() if key.endswith("/name")}
    assert set(names) == {f"ViewLayer.Crypto{of}" for of in ("Object", "Material", "Asset")}
    described = f"cryptomatte/{names['ViewLayer.CryptoObject']}"
    assert '"Moving":' in header[f"{described}/manifest"] and '"Floor":' in header[f"{described}/manifest"]
    assert header[f"{described}/hash"] == "MurmurHash3_32"
    assert header[f"{described}/conversion"] == "uint32_to_float32"


def test_the_noisy_image_is_the_picture_before_the_denoiser(still_life, tmp_path):
    tick(still_life.view_layers[0], {"denoising_normal"})
    still_life.cycles.use_denoising, still_life.cycles.film_exposure = True, 2
    still_life.renderformer_v2.guide_samples = 2

    def rendered():
        found = press_f12(still_life, tmp_path)
        return found["ViewLayer.Noisy Image"], found["ViewLayer.Combined"]

    def roughness(picture):
        return np.abs(np.diff(picture[..., :3], axis=1)).mean()
    noisy, clean = rendered()
    assert roughness(noisy) > 1.1 * roughness(clean) and noisy.mean() == pytest.approx(clean.mean(), rel=0.02)
    np.testing.assert_array_equal(noisy[..., 3], clean[..., 3])
    still_life.renderformer_v2.light = "NETWORK"  # nothing is denoised
    np.testing.assert_array_equal(*rendered())


def test_unticked_passes_have_no_sockets(scene):
    layer = scene.view_layers[0]
    layer.use_pass_z = False
    assert sockets(scene) == {"Image", "Alpha"}


@pytest.mark.parametrize("key", ["normal", "diffuse_direct"])
def test_a_shader_aov_with_the_name_of_what_we_compute_is_marked_and_does_no_harm(still_life, tmp_path, key):
    name = next(p.blender_name for p in passes.PASSES if p.key == key)
    layer = still_life.view_layers[0]
    layer.use_pass_diffuse_direct, layer.use_pass_glossy_direct = False, True
    aov = layer.aovs.add()
    aov.name = name
    layer.update_render_passes()
    assert not aov.is_valid
    found = press_f12(still_life, tmp_path)
    assert found[f"ViewLayer.{name}"].shape[-1] == 3


def settings_in_panel(scene):
    return {setting for rows in view_layer.available_passes(scene).values() for setting in rows}


def test_light_that_the_weights_cannot_give_is_absent(scene, tmp_path, monkeypatch):
    tick(scene.view_layers[0], passes.LIGHTING)
    light = {p.blender_name for p in passes.PASSES if p.source == "lighting"}
    assert light <= sockets(scene) and "use_pass_diffuse_direct" in settings_in_panel(scene)

    scene.renderformer_v2.light = "NETWORK"
    assert light <= sockets(scene) and not passes.absent(scene, scene.view_layers[0], light_passes(scene))

    write_bundle(tmp_path / "renderformer-v2", tiny_published_config(), TRANSFORMERS)
    monkeypatch.setenv(published_weights.WEIGHTS_VARIABLE, str(tmp_path))
    scene.renderformer_v2.weights_source = "PUBLISHED"
    assert not light & sockets(scene) and "use_pass_diffuse_direct" not in settings_in_panel(scene)
    assert "use_pass_diffuse_color" in settings_in_panel(scene)
    assert set(passes.absent(scene, scene.view_layers[0], light_passes(scene))) == light
