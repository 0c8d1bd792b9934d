# SPDX-License-Identifier: GPL-3.0-or-later
"""The network as a graphics card would run it, without one: nothing waits in its loops, and its memory is known."""
import weakref
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode

from renderformer_v2.model.compute import inference as inference_module
from renderformer_v2.model.compute.inference import current_pieces, cuts, inference
from renderformer_v2.model.compute.threads import team
from renderformer_v2.model.network import attention_with_lse, block_attention, renderformer
from renderformer_v2.model.network.block_attention import Window
from renderformer_v2.model.network.inputs import ViewInputs
from renderformer_v2.model.network.memory_estimate import count_view_parameters, estimate_card_bytes
from renderformer_v2.model.network.renderformer import KEYS_VALUES_BYTES, RenderFormer, SceneContext, store_as_released
from renderformer_v2.model.published.image_encoder import OneFrameEncoder
from renderformer_v2.model.renderer import Renderer
from renderformer_v2.model.weights.presets import rf2_200m
from tests.described_cards import describe
from tests.model import card_kernels
from tests.model.no_host_copies import NoHostCopies
from tests.model.samples import floor_scene, floor_view
from tools.benchmark.textures import make_textured_scene

CARD = torch.device("cuda", 0)


@pytest.fixture(params=[inference_module.GPU_CHUNK, 1 << 20], ids=["in pieces", "whole"])
def as_on_a_card(monkeypatch, request):
    """PyTorch's own attention, and pieces as large as a card gets, one after the other: what is watched is a thread."""
    card_kernels.pretend(monkeypatch)
    monkeypatch.setattr(block_attention, "uses_fused_attention", lambda q: True)
    monkeypatch.setattr(inference_module, "CHUNK", request.param)
    with team(1):
        yield


@inference()
def test_stage_1_never_waits_for_the_card(as_on_a_card, tiny_network):
    config, count, sink = tiny_network.config, 10_000, 120
    tokens, positions = torch.randn(count, config.latent_dim), torch.randn(count, 3)
    with NoHostCopies() as watched:
        tiny_network.transformer(tokens, positions, sink)
    pieces = -(-(count - sink) // inference_module.CHUNK)
    # Of each layer: the sink's queries; of each piece the sink's keys, and the bands inside; those at both ends.
    assert watched.attentions == config.num_layers * (1 + 2 * pieces + 2)


@inference()
def test_a_card_has_the_numbers_of_a_processor(as_on_a_card, tiny_network, tiny_inputs, rays, monkeypatch):
    count, width = 3000, tiny_network.config.latent_dim
    tokens, positions = torch.randn(count, width), torch.randn(count, 3)
    found = tiny_network.transformer(tokens.clone(), positions, 120), tiny_network(tiny_inputs, rays)
    monkeypatch.undo()
    expected = tiny_network.transformer(tokens.clone(), positions, 120), tiny_network(tiny_inputs, rays)
    for x, y in zip(found, expected):
        torch.testing.assert_close(x, y, atol=1e-5 * y.abs().max().item(), rtol=1e-5)


@pytest.mark.parametrize("free, expected", [(80e9, 697_544), (8e9, 69_754), (5e8, 4359), (1e8, 4096)])
def test_a_card_computes_as_much_of_a_sequence_at_once_as_its_free_memory_is_enough_for(monkeypatch, free, expected):
    describe(monkeypatch, ("NVIDIA H100", (9, 0), 80), free=free)
    with inference():
        assert current_pieces().sequence_rows(CARD, 100) == expected
        assert [p.stop - p.start for p in cuts(0, 10_000, CARD)] == [
            min(expected, 10_000 - begin) for begin in range(0, 10_000, expected)]
        assert current_pieces().rows(CARD) == inference_module.GPU_CHUNK  # of all that is no such sequence
        assert current_pieces().sequence_rows(torch.device("cpu"), 100) == 100


@inference()
def test_a_row_takes_less_of_a_cards_memory_than_is_reckoned_with(monkeypatch):
    card_kernels.pretend(monkeypatch)
    monkeypatch.setattr(renderformer, "has_tensor_float_32", lambda device: True)
    monkeypatch.setattr(inference_module, "CHUNK", 1 << 20)
    config, grid, rows = replace(rf2_200m(), num_layers=1), (1, 128, 128), 128 * 128
    with torch.device("meta"):
        network = store_as_released(RenderFormer(config), torch.bfloat16, CARD)
        x, positions = torch.empty(rows, config.latent_dim), torch.empty(rows, 3)
    first, second = network.transformer, network.view_transformer.transformer
    with Held() as stage1:
        first.layers[0](x, first.rope_emb(positions), Window(rows, 200, 256, x.device))
    keys = second.layers[1].keys_values(x, second.rope_emb(positions))
    with Held() as stage2:
        second.layers[1](x.view(*grid, -1), second.rope_emb(positions), keys)
    assert stage1.most < stage2.most < inference_module.ROW_BYTES * rows < 1.2 * stage2.most


@inference()
def test_stage_2_and_the_decoder_never_wait_for_the_card(as_on_a_card, tiny_network, tiny_inputs, rays):
    context = tiny_network.encode_scene(tiny_inputs)
    with NoHostCopies():
        tiny_network.render_view(context, rays)


@pytest.mark.parametrize("bad", [lambda x: x[x > 0], lambda x: x.sum().item(), lambda x: bool(x.any()),
                                 lambda x: x.double(), lambda x: x.nonzero()])
def test_what_makes_a_card_wait_is_found(bad):
    with NoHostCopies(), pytest.raises(AssertionError):
        bad(torch.randn(4))


def test_a_card_that_is_too_small_works_in_smaller_pieces_and_says_so(published_bundle, monkeypatch):
    renderer, scene = Renderer(published_bundle, device="cpu", precision="fp32"), floor_scene()
    view, guides = floor_view()
    expected = renderer.encode(scene).view(view, guides)
    describe(monkeypatch, ("NVIDIA H100", (9, 0), 80), free=8e9)
    tried, encode = [], renderer.pipeline.encode

    def small(*given):
        tried.append((current_pieces().rows(CARD), current_pieces().sequence_rows(CARD)))
        if len(tried) < 3:
            raise torch.OutOfMemoryError("CUDA out of memory")
        return encode(*given)

    renderer.pipeline.encode = small
    found = renderer.encode(scene)
    assert tried == [(4096, 69_754), (1024, 1024), (256, 256)] and "smaller ones" in renderer.remark
    np.testing.assert_allclose(found.view(view, guides), expected, rtol=1e-4, atol=1e-5 * expected.max())
    assert not found.encoded.context.keys_values
    assert Renderer(published_bundle, device="cpu", precision="fp32").pieces.are_small is False


def test_a_card_that_is_too_small_encodes_fewer_textures_at_once(published_bundle, monkeypatch):
    renderer, scene, batches = Renderer(published_bundle, device="cpu", precision="fp32"), make_textured_scene(9), []
    real = OneFrameEncoder.forward

    def small(self, images):
        batches.append(len(images))
        if len(images) > 16:
            raise torch.OutOfMemoryError("CUDA out of memory")
        return real(self, images)

    monkeypatch.setattr(OneFrameEncoder, "forward", small)
    renderer.prepare(scene)
    assert max(batches) > 16 and max(batches[1:]) == 16 and "smaller ones" in renderer.remark


def test_a_card_that_is_much_too_small_is_said(published_bundle):
    def never():
        raise torch.OutOfMemoryError("CUDA out of memory")
    with pytest.raises(torch.OutOfMemoryError):
        Renderer(published_bundle, device="cpu", precision="fp32").fitted(never)


class Held(TorchDispatchMode):
    """The most bytes that tensors of the meta device would have held at once."""

    def __init__(self):
        super().__init__()
        self.now, self.most, self._known = 0, 0, set()

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        result = func(*args, **(kwargs or {}))
        for x in result if isinstance(result, (tuple, list)) else [result]:
            if isinstance(x, torch.Tensor):
                self._hold(x.untyped_storage())
        return result

    def _hold(self, storage) -> None:
        key, size = storage._cdata, storage.nbytes()
        if key in self._known:
            return
        self._known.add(key)
        self.now += size
        self.most = max(self.most, self.now)
        weakref.finalize(storage, self._forget, key, size)

    def _forget(self, key: int, size: int) -> None:
        self._known.discard(key)
        self.now -= size


@pytest.mark.parametrize("exact", [False, True], ids=["bf16", "stage 2 in float32"])
@pytest.mark.parametrize("tokens, side", [(3000, 256), pytest.param(20000, 512, marks=pytest.mark.slow)])
@inference()
def test_the_estimate_of_a_cards_memory_is_enough_and_not_much_more(tokens, side, exact, monkeypatch):
    monkeypatch.setattr(renderformer, "has_tensor_float_32", lambda device: exact)
    monkeypatch.setattr(block_attention, "has_kernels", lambda device: True)
    monkeypatch.setattr(attention_with_lse, "is_right", lambda *_: True)
    monkeypatch.setattr(inference_module, "CHUNK", inference_module.GPU_CHUNK)
    config = replace(rf2_200m(), num_layers=1)  # all layers of stage 1 use the same memory
    with torch.device("meta"):
        network = store_as_released(RenderFormer(config), torch.bfloat16, torch.device("cpu"))
        given, positions = torch.empty(tokens, config.latent_dim), torch.empty(tokens, 3)
        rays = ViewInputs(torch.empty(1, 3), torch.empty(1, side, side, 3))
        triangle = torch.empty(tokens, dtype=torch.long)
    with Held() as stage1:
        done = network.transformer(given, positions, 80 + tokens // 64)
    with Held() as stage2:
        network.render_view(SceneContext(done, positions, triangle, 100, caches=True), rays)
    held = max(stage1.most, stage2.most)
    asked = estimate_card_bytes(config, 0, tokens, side * side, (2, 4 if exact else 2), KEYS_VALUES_BYTES)
    asked -= 2 * count_view_parameters(config) * exact
    assert held < asked < 2.5 * held
