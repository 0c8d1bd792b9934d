# SPDX-License-Identifier: GPL-3.0-or-later
"""What a render says of the device that it used, of a card that it did not, and of a card's memory."""
import sys
from dataclasses import replace

import bpy
import OpenEXR
import pytest
import torch

from bl_ext.user_default.renderformer_v2.model.compute import devices, precision
from bl_ext.user_default.renderformer_v2.model.compute.devices import free_memory
from bl_ext.user_default.renderformer_v2.model.network.memory_estimate import card_bytes
from bl_ext.user_default.renderformer_v2.model.network.renderformer import KEYS_VALUES_BYTES, RenderFormer
from bl_ext.user_default.renderformer_v2.model.published.image_encoder import OneFrameEncoder, vae_class
from bl_ext.user_default.renderformer_v2.model.weights.presets import rf2_200m
from bl_ext.user_default.renderformer_v2.rf2_engine.frame import card, preflight
from bl_ext.user_default.renderformer_v2.rf2_engine.progress import frame_lines, last_render
from bl_ext.user_default.renderformer_v2.rf2_engine.runtime import model_cache
from bl_ext.user_default.renderformer_v2.rf2_engine.settings import FrameSettings
from bl_ext.user_default.renderformer_v2.rf2_engine.setup import published_weights

from tests.rf2_engine.f12 import press_f12


def test_the_device_and_its_number_format_are_said_everywhere(lit, tmp_path, monkeypatch):
    monkeypatch.setattr(model_cache, "unused_card", lambda network: "the NVIDIA card is not used, because of a test")
    lit.renderformer_v2.reference.use = False
    model_cache.free()
    press_f12(lit, tmp_path)
    (layer,) = last_render.last_frame
    assert layer.device.startswith("CPU") and layer.device.endswith("Float32")
    assert layer.device in layer.lines[0] and frame_lines.of_layer(layer)["device"] == layer.device
    assert "approximated Device: the NVIDIA card is not used, because of a test" in layer.report
    with OpenEXR.File(str(tmp_path / "picture.exr")) as file:
        assert file.header()["RenderFormer-V2 device"] == layer.device


@pytest.mark.parametrize("needed, free, said", [(2e9, 8e9, "2.0 GB are needed, 8.0 GB are free"),
                                                (9e9, 8e9, "smaller pieces")])
def test_preflight_tells_what_a_card_needs(lit, monkeypatch, needed, free, said):
    monkeypatch.setattr(card, "memory", lambda *given: (needed, free))
    found = preflight.run(bpy.context.evaluated_depsgraph_get(), lambda text, fraction: None)
    assert not found.error and any(said in line for line in found.lines)


@pytest.mark.parametrize("needed, said", [(2e9, False), (9e9, True)])
def test_a_card_that_may_be_too_small_is_said_before_the_network_begins(lit, tmp_path, monkeypatch, needed, said):
    monkeypatch.setattr(card, "memory", lambda settings, tokens, pixels: (needed, 8e9) if tokens > 10 else None)
    press_f12(lit, tmp_path)
    (layer,) = last_render.last_frame
    assert any("8.0 GB are free: if that is too little" in line for line in layer.report) == said


def test_a_network_that_is_there_already_needs_no_more_memory(monkeypatch):
    for name, found in (("mem_get_info", (6, 10)), ("memory_reserved", 3), ("memory_allocated", 2)):
        monkeypatch.setattr(torch.cuda, name, lambda device, found=found: found)
    assert free_memory(torch.device("cuda", 0)) == 7 and free_memory(torch.device("cuda", 0), with_ours=True) == 9


@pytest.mark.parametrize("device, driver, imported", [("auto", True, True), ("auto", False, False),
                                                      ("cpu", True, False)])
def test_pytorch_is_imported_for_a_card_that_may_be_used(lit, monkeypatch, device, driver, imported):
    calls = []
    monkeypatch.delitem(sys.modules, "torch")
    monkeypatch.setattr(card.wheels, "has_nvidia_driver", lambda: driver)
    monkeypatch.setattr(card.importing, "import_packages", lambda: calls.append(1))
    lit.renderformer_v2.device = device
    assert card.memory(FrameSettings.of(lit), 1000, 64 * 64) is None  # there is no card
    assert bool(calls) == imported


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
def test_the_published_weights_are_counted_in_the_precision_that_a_card_holds_them_in(lit, monkeypatch, dtype):
    monkeypatch.setattr(devices, "free_memory", lambda device, with_ours: 8e9)
    monkeypatch.setattr(precision, "choose_precision", lambda name, device: dtype)
    settings = replace(FrameSettings.of(lit), light_passes=frozenset())
    assert not settings.guided
    needed, _ = card.memory(settings, 1000, 64 * 64)
    config, item = rf2_200m(), dtype.itemsize
    weights = needed - card_bytes(config, 0, 1000, 64 * 64, (item, item), KEYS_VALUES_BYTES)
    with torch.device("meta"):
        network = precision.in_precision(RenderFormer(config), dtype)
        held = sum(p.nbytes for part in (network, OneFrameEncoder(vae_class()())) for p in part.parameters())
    assert held < weights < 1.01 * held


def test_without_a_card_nothing_is_said_of_one(lit):
    found = preflight.run(bpy.context.evaluated_depsgraph_get(), lambda text, fraction: None)
    assert not found.error and not any(line.startswith("Card") for line in found.lines)


def test_a_budget_for_the_published_weights_is_suggested(scene):
    bpy.ops.renderformer_v2.suggested_budget()
    assert scene.renderformer_v2.token_budget == 16384


def test_encoded_textures_can_be_deleted(scene, tmp_path, monkeypatch):
    file = tmp_path / "latents.sqlite"
    monkeypatch.setattr(published_weights, "latents_file", lambda: file)
    assert not bpy.ops.renderformer_v2.remove_latents.poll()
    for ending in ("", "-journal"):
        file.with_name(file.name + ending).write_bytes(b"some")
    assert bpy.ops.renderformer_v2.remove_latents() == {"FINISHED"}
    assert not list(tmp_path.iterdir())
