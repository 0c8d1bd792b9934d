# SPDX-License-Identifier: GPL-3.0-or-later
"""What a render says of the device that it used, of a card that it did not, and of a card's memory."""
import sys
from dataclasses import replace

import bpy
import OpenEXR
import pytest
import torch

from bl_ext.user_default.renderformer_v2.model import renderer
from bl_ext.user_default.renderformer_v2.model.compute.devices import free_memory
from bl_ext.user_default.renderformer_v2.model.network.layers import store_in_precision
from bl_ext.user_default.renderformer_v2.model.network.memory_estimate import estimate_card_bytes
from bl_ext.user_default.renderformer_v2.model.network.renderformer import KEYS_VALUES_BYTES, RenderFormer
from bl_ext.user_default.renderformer_v2.model.published.image_encoder import OneFrameEncoder, vae_class
from bl_ext.user_default.renderformer_v2.model.weights.presets import rf2_200m
from bl_ext.user_default.renderformer_v2.rf2_engine.frame import card, preflight
from bl_ext.user_default.renderformer_v2.rf2_engine.frame_settings import FrameSettings, Network
from bl_ext.user_default.renderformer_v2.rf2_engine.progress import frame_lines, last_render
from bl_ext.user_default.renderformer_v2.rf2_engine.runtime import model_cache
from bl_ext.user_default.renderformer_v2.rf2_engine.setup import published_weights

from tests.described_cards import describe
from tests.rf2_engine.f12 import press_f12

AMPERE = ("GeForce RTX 3070", (8, 6), 8)


@pytest.fixture
def card_beside(monkeypatch):
    """Function that puts a card with so many free bytes into the machine, while the network stays on the CPU."""
    def put(free):
        describe(monkeypatch, AMPERE, free=free)
        monkeypatch.setattr(renderer, "choose_device", lambda name: torch.device("cpu"))
    model_cache.free()
    yield put
    model_cache.free()


def test_the_device_and_its_number_format_are_said_everywhere(lit, tmp_path, monkeypatch):
    describe(monkeypatch, ("GeForce GTX 1080", (6, 1), 8))
    lit.renderformer_v2.reference.use = False
    model_cache.free()
    press_f12(lit, tmp_path)
    (layer,) = last_render.last_frame
    assert layer.device.startswith("CPU") and layer.device.endswith("Float32")
    assert layer.device in layer.lines[0] and frame_lines.describe_layer(layer)["device"] == layer.device
    assert any(line.startswith("approximated Device: GeForce GTX 1080 (compute capability 6.1) is not used")
               for line in layer.report)
    with OpenEXR.File(str(tmp_path / "picture.exr")) as file:
        assert file.header()["RenderFormer-V2 device"] == layer.device


@pytest.mark.parametrize("free, said", [(64e9, "64.0 GB are free"), (1e6, "0.0 GB are free: if that is too little")])
def test_preflight_tells_what_a_card_needs(lit, monkeypatch, free, said):
    describe(monkeypatch, AMPERE, free=free)
    found = preflight.run(bpy.context.evaluated_depsgraph_get(), lambda text, fraction: None)
    needed, known = card.memory(FrameSettings.read(lit), found.tokens, 50 * 37)
    assert not found.error and known == free
    assert found.card.startswith(f"GPU: at most {needed / 1e9:.1f} GB are needed, {said}")


@pytest.mark.parametrize("network", [Network.GUIDED, Network.PUBLISHED])
def test_more_pixels_and_more_triangles_need_more_of_a_card(lit, monkeypatch, network):
    describe(monkeypatch, AMPERE)
    settings = replace(FrameSettings.read(lit), network=network)
    small, of_many, of_large = (card.memory(settings, *size)[0] for size in ((1000, 64 * 64), (100_000, 64 * 64),
                                                                             (1000, 3840 * 2160)))
    assert 0 < small < of_large and small < of_many


@pytest.mark.parametrize("free, said", [(64e9, False), (1e6, True)])
def test_a_card_that_may_be_too_small_is_said_before_the_network_begins(lit, tmp_path, card_beside, free, said):
    card_beside(free)
    press_f12(lit, tmp_path)
    (layer,) = last_render.last_frame
    assert any("0.0 GB are free: if that is too little" in line for line in layer.report) == said


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
    assert card.memory(FrameSettings.read(lit), 1000, 64 * 64) is None  # there is no card
    assert bool(calls) == imported


@pytest.mark.parametrize("chosen, dtype", [("fp32", torch.float32), ("auto", torch.bfloat16)])
def test_the_published_weights_are_counted_in_the_precision_that_a_card_holds_them_in(lit, monkeypatch, chosen, dtype):
    describe(monkeypatch, AMPERE)
    settings = replace(FrameSettings.read(lit), network=Network.PUBLISHED, precision=chosen)
    needed, _ = card.memory(settings, 1000, 64 * 64)
    config = rf2_200m()
    weights = needed - estimate_card_bytes(config, 0, 1000, 64 * 64, (dtype.itemsize, 4), KEYS_VALUES_BYTES)
    with torch.device("meta"):
        network = store_in_precision(RenderFormer(config), dtype)
        held = sum(p.nbytes for part in (network, OneFrameEncoder(vae_class()())) for p in part.parameters())
    assert held < weights < 1.01 * held


def test_without_a_card_nothing_is_said_of_one(lit):
    found = preflight.run(bpy.context.evaluated_depsgraph_get(), lambda text, fraction: None)
    assert not found.error and not any(line.startswith("GPU") for line in found.lines)


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


def test_the_bundled_network_needs_memory_for_pixels_above_all(lit, monkeypatch):
    describe(monkeypatch, AMPERE)
    settings = FrameSettings.read(lit)
    assert settings.network is Network.GUIDED
    small, large = (card.memory(settings, 4096, pixels)[0] for pixels in (512 * 512, 4096 * 2160))
    assert small < 1.3e9 and 5e9 < large < 9e9
