# SPDX-License-Identifier: GPL-3.0-or-later
"""Whatever a user gets wrong: a message that names it, and never a traceback or a silent black frame."""
import json
import types

import bpy
import numpy as np
import pytest

import addon_utils
from bl_ext.user_default.renderformer_v2.model.weights import checkpoint, presets
from bl_ext.user_default.renderformer_v2.rf2_engine.frame import first_picture, preflight
from bl_ext.user_default.renderformer_v2.rf2_engine.panels import render_settings
from bl_ext.user_default.renderformer_v2.rf2_engine.progress.last_render import last_frame
from bl_ext.user_default.renderformer_v2.rf2_engine.runtime import device, model_cache
from bl_ext.user_default.renderformer_v2.rf2_engine.setup import packages

from tests.described_cards import describe
from tests.rf2_engine.f12 import cube, mesh_object, press_f12, sun
from tests.rf2_engine.layout import Layout

NAN = float("nan")
SMALL = json.dumps(checkpoint.FORMAT | {"model_config": presets.rf2_small().to_dict()})


def expect_error(scene, tmp_path, *words):
    with pytest.raises(RuntimeError) as error:
        bpy.ops.render.render(scene=scene.name)
    for word in words:
        assert word in str(error.value)
    assert "Internal error" not in str(error.value)
    picture = press_f12(scene, tmp_path, may_fail=True)
    assert picture["ViewLayer.Combined"][..., :3].max() > 0.1
    assert (picture["ViewLayer.Combined"][..., 3] == 1).all()


def test_scene_without_a_camera(scene):
    scene.camera = None
    with pytest.raises(RuntimeError, match="(?i)camera"):
        bpy.ops.render.render(scene=scene.name)


def test_camera_of_a_type_that_is_not_supported_is_named(scene, tmp_path):
    cube(scene)
    scene.camera.name = "Own"
    scene.camera.data.type = "CUSTOM"
    expect_error(scene, tmp_path, "Own", "Perspective")


def test_light_used_as_camera_is_named(scene, tmp_path):
    scene.camera = sun(scene)
    expect_error(scene, tmp_path, "Sun")


def test_empty_scene_shows_its_world(scene, tmp_path):
    picture = press_f12(scene, tmp_path)["ViewLayer.Combined"]
    assert np.allclose(picture, (0.25, 0.25, 0.25, 1), atol=1e-6)


def test_scene_without_a_world_renders(scene, tmp_path):
    scene.world = None
    cube(scene)
    sun(scene)
    picture = press_f12(scene, tmp_path)["ViewLayer.Combined"]
    assert np.isfinite(picture).all() and (picture[0, 0] == (0, 0, 0, 1)).all()


def test_vertices_that_are_not_finite_are_reported_by_name(scene, tmp_path):
    cube(scene)
    mesh_object(scene, "Broken", [(0, 0, 0), (1, 0, NAN), (0, 1, 0), (2, 0, 2)], [(0, 1, 2), (0, 2, 3)])
    picture = press_f12(scene, tmp_path)["ViewLayer.Combined"]
    assert np.isfinite(picture).all()
    assert any("Broken" in line for line in last_frame[0].report)


def set_input(name, value):
    def change(box, lamp):
        box.data.materials[0].node_tree.nodes["Principled BSDF"].inputs[name].default_value = value
    return change


def set_energy(box, lamp):
    lamp.data.energy = NAN


def set_world(box, lamp):
    bpy.context.scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = NAN


def set_density(box, lamp):
    tree = box.data.materials[0].node_tree
    node = tree.nodes.new("ShaderNodeVolumeScatter")
    node.inputs["Density"].default_value = NAN
    tree.links.new(node.outputs[0], tree.nodes["Material Output"].inputs["Volume"])


def stretch(box, lamp):
    box.data.vertices[0].co = (3e38, -3e38, 0)


@pytest.mark.parametrize("change, name", [
    (set_energy, "Sun"), (set_world, "Grey"), (set_density, "Cube"), (stretch, "Cube"),
    (set_input("Base Color", (NAN, 0, 0, 1)), "Cube"), (set_input("Emission Strength", NAN), "Cube"),
], ids=["energy", "world", "density", "vertex", "color", "emission"])
def test_values_that_are_not_finite_are_reported_by_name(scene, tmp_path, change, name):
    change(cube(scene), sun(scene))
    picture = press_f12(scene, tmp_path)["ViewLayer.Combined"]
    assert np.isfinite(picture).all() and picture[..., :3].max() > 0
    assert any(line.startswith(f"refused {name}: ") for line in last_frame[0].report)


def test_a_material_without_a_normal_is_rendered_and_reported(scene, tmp_path):
    box, _ = cube(scene), sun(scene)
    tree = box.data.materials[0].node_tree
    node = tree.nodes.new("ShaderNodeNormalMap")
    node.inputs["Color"].default_value = 0.5, 0.5, 0.5, 1
    tree.links.new(node.outputs["Normal"], tree.nodes["Principled BSDF"].inputs["Normal"])
    picture = press_f12(scene, tmp_path)
    assert all(np.isfinite(values).all() for values in picture.values())
    reported = any(line.startswith("approximated Normal: ") for line in last_frame[0].report)
    assert reported == (bpy.app.version < (5, 0))  # from then on Cycles takes the surface's own normal


@pytest.mark.parametrize("strength, energy", [(3e-7, 3), (3e38, 3), (0, 1e-12), (0, 3e38)])
def test_light_too_faint_or_too_bright_to_count_does_no_harm(scene, tmp_path, strength, energy):
    box, lamp = cube(scene), sun(scene)
    set_input("Emission Color", (1, 1, 1, 1))(box, lamp)
    set_input("Emission Strength", strength)(box, lamp)
    lamp.data.energy = energy
    assert np.isfinite(press_f12(scene, tmp_path)["ViewLayer.Combined"]).all()


def test_endless_chain_of_nodes_is_cut_and_reported(scene, tmp_path):
    tree = cube(scene).data.materials[0].node_tree
    last = tree.nodes.new("ShaderNodeValue").outputs[0]
    for _ in range(400):
        node = tree.nodes.new("ShaderNodeMath")
        tree.links.new(last, node.inputs[0])
        last = node.outputs[0]
    tree.links.new(last, tree.nodes["Principled BSDF"].inputs["Roughness"])
    press_f12(scene, tmp_path)
    assert any("Cube" in line and "chain of nodes" in line for line in last_frame[0].report)


def test_cycles_switched_off_is_said(scene, tmp_path):
    cube(scene)
    addon_utils.disable("cycles")
    try:
        expect_error(scene, tmp_path, "Cycles", "Preferences > Add-ons")
    finally:
        addon_utils.enable("cycles")


def test_failed_render_replaces_the_statistics_of_the_last(scene, tmp_path):
    cube(scene)
    press_f12(scene, tmp_path)
    scene.renderformer_v2.weights_source = "FOLDER"
    expect_error(scene, tmp_path, "no folder is chosen")
    assert "no folder is chosen" in last_frame[0].error


def test_zero_area_triangles_do_no_harm(scene, tmp_path):
    cube(scene)
    mesh_object(scene, "Needle", [(0, 0, 0), (1, 1, 1), (2, 2, 2), (0, 0, 0)], [(0, 1, 2), (0, 1, 3)])
    picture = press_f12(scene, tmp_path)["ViewLayer.Combined"]
    assert np.isfinite(picture).all() and picture[18, 25, :3].min() > 0


def test_missing_texture_is_reported_by_name(scene, tmp_path):
    box = cube(scene)
    box.data.uv_layers.new()
    tree = box.data.materials[0].node_tree
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = bpy.data.images.new("Lost", 4, 4)
    node.image.source, node.image.filepath = "FILE", str(tmp_path / "lost.png")
    tree.links.new(node.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    picture = press_f12(scene, tmp_path)["ViewLayer.Combined"]
    assert np.isfinite(picture).all()
    assert any("lost" in line.lower() for line in last_frame[0].report)


@pytest.mark.parametrize("files", [
    {},
    {"config.json": "{ not json"},
    {"config.json": json.dumps({"latent_dim": 768})},
    {"config.json": SMALL},
    {"config.json": SMALL, "model.safetensors": ""},
    {"config.json": SMALL, "model.safetensors": "these are not weights" * 100},
], ids=["empty folder", "broken config", "another format", "no weights", "empty weights", "corrupt weights"])
def test_unusable_weights_are_named(scene, tmp_path, files):
    cube(scene)
    model_cache.free()
    folder = tmp_path / "my weights"
    folder.mkdir()
    for name, content in files.items():
        (folder / name).write_text(content)
    scene.renderformer_v2.weights_source = "FOLDER"
    scene.renderformer_v2.weights_folder = str(folder)
    expect_error(scene, tmp_path, "my weights")
    assert not model_cache.is_loaded()


def test_missing_packages_come_with_instructions(scene, tmp_path, monkeypatch):
    monkeypatch.setitem(packages.PACKAGES, "torch_that_is_not_there", "safetensors")
    monkeypatch.setattr(packages, "NETWORK", (*packages.NETWORK, "torch_that_is_not_there"))
    expect_error(scene, tmp_path, "torch_that_is_not_there", "Install Packages", "pip install")


@pytest.mark.parametrize("chosen, name", [("cuda", "CUDA"), ("mps", "Metal")])
def test_a_device_that_is_not_there_is_refused_before_anything_is_traced(scene, tmp_path, monkeypatch, chosen, name):
    import torch
    describe(monkeypatch, driver=0)
    monkeypatch.setattr(torch.backends.mps, "is_available", lambda: False)
    monkeypatch.setattr(device, "_answers", {})
    monkeypatch.setattr(first_picture, "show", lambda *_: pytest.fail("the scene is being read"))
    cube(scene)
    scene.renderformer_v2.device = chosen
    expected = f"Device is {name}, but PyTorch finds no GPU for it: set Device to Automatic or CPU"
    expect_error(scene, tmp_path, expected)
    assert preflight.run(bpy.context.evaluated_depsgraph_get(), lambda *_: None).error == expected
    layout = Layout()
    panel = types.SimpleNamespace(split_layout=lambda: layout)
    render_settings.RENDERFORMER_PT_settings.draw(panel, types.SimpleNamespace(scene=scene))
    assert expected in " ".join(layout.texts)
