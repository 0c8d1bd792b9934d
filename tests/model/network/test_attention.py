# SPDX-License-Identifier: GPL-3.0-or-later
"""Window + sink attention and attention over blocks, against PyTorch's attention with a dense mask."""
from contextlib import nullcontext

import pytest
import torch
from torch.nn import functional as F

from renderformer_v2.model import progress
from renderformer_v2.model.compute import inference as inference_module
from renderformer_v2.model.compute.inference import inference
from renderformer_v2.model.network import attention_with_lse, block_attention
from renderformer_v2.model.network.block_attention import KeysValues, Window, attend_to_all
from tests.model import card_kernels
from tools.parity.self_check import window_sink_attention

SIZES = [(1, 0, 2), (9, 9, 2), (12, 3, 2), (40, 0, 3), (300, 7, 1), (513, 0, 256), (600, 20, 256), (700, 30, 8),
         (1339, 102, 256), (1000, 5, 300), (257, 1, 255), (262, 5, 256), (2000, 600, 40)]


def masked_reference(q, k, v, sink, half):
    index = torch.arange(len(q))
    visible = (index[:, None] - index).abs() <= half
    visible[:sink], visible[:, :sink] = True, True
    q, k, v = (x.transpose(0, 1)[None].double() for x in (q, k, v))
    return F.scaled_dot_product_attention(q, k, v, attn_mask=visible)[0].float()


def sequence(length, seed, scale=1.0, heads=2, width=16):
    q, k, v = torch.randn(3, length, heads, width, generator=torch.Generator().manual_seed(seed))
    return scale * q, k, v


@pytest.mark.parametrize("gradients", [False, True])
@pytest.mark.parametrize("length, sink, half", SIZES)
@pytest.mark.parametrize("dtype, tolerance", [(torch.float32, 1e-5), (torch.bfloat16, 5e-2)])
def test_window_sink_attention_equals_a_dense_mask(length, sink, half, dtype, tolerance, gradients):
    q, k, v = sequence(length, seed=length)
    with nullcontext() if gradients else inference():
        actual = window_sink_attention(q.to(dtype), k.to(dtype), v.to(dtype), sink, half)
    assert actual.dtype == dtype
    torch.testing.assert_close(actual.float(), masked_reference(q, k, v, sink, half), atol=tolerance, rtol=tolerance)


@pytest.mark.parametrize("rows", [pytest.param(300, id="small pieces"), pytest.param(1 << 20, id="whole"),
                                  pytest.param(1024, id="pieces", marks=pytest.mark.slow)])
@pytest.mark.parametrize("has_kernels", [False, True])
@pytest.mark.parametrize("length, sink, half", SIZES)
@pytest.mark.parametrize("dtype, tolerance", [(torch.float32, 1e-5), (torch.bfloat16, 5e-2)])
@inference()
def test_on_a_card_sink_and_band_by_themselves_equal_a_dense_mask(length, sink, half, dtype, tolerance, has_kernels,
                                                                  rows, monkeypatch):
    kernels = card_kernels.pretend(monkeypatch)
    if not has_kernels:
        monkeypatch.setattr(attention_with_lse, "is_right", lambda *_: False)
    monkeypatch.setattr(block_attention, "uses_fused_attention", lambda q: True)
    monkeypatch.setattr(inference_module, "CHUNK", rows)
    q, k, v = sequence(length, seed=length, width=20)
    actual = window_sink_attention(q.to(dtype), k.to(dtype), v.to(dtype), sink, half)
    assert actual.dtype == dtype
    torch.testing.assert_close(actual.float(), masked_reference(q, k, v, sink, half), atol=tolerance, rtol=tolerance)
    is_sparse = length - sink > half + 1
    assert bool(kernels.calls) == (has_kernels and is_sparse)
    if kernels.calls:
        pieces = -(-(length - sink) // rows)
        assert [name for name, bias in kernels.calls].count("flash") == (pieces if sink else 0)
        assert all(bias is not None for name, bias in kernels.calls if name == "efficient")


@inference()
def test_on_a_card_bands_in_the_interior_read_keys_where_they_are_and_share_one_mask(monkeypatch):
    kernels = card_kernels.pretend(monkeypatch)
    monkeypatch.setattr(block_attention, "uses_fused_attention", lambda q: True)
    q, k, v = (x.transpose(0, 1).contiguous() for x in sequence(5000, seed=0, width=16))
    given = []
    monkeypatch.setattr(block_attention, "attention_with_lse", lambda *x, real=attention_with_lse.attention_with_lse:
                        given.append(x) or real(*x))
    Window(5000, 100, 256, q.device).attend(q[:, 100:], KeysValues([(k, v)]), 100)
    inside = [k.data_ptr() <= keys.data_ptr() < k.data_ptr() + k.nbytes for _, keys, *_ in given]
    bands = [len(several) for several, *_ in given]
    assert inside == [False, True, False, True] and bands == [1, 17, 2, 1]
    assert given[1][3].shape == (256, 768) and len(kernels.calls) == 4


@pytest.mark.parametrize("scale", [1e-3, 1.0, 40.0, 3e3])
@inference()
def test_large_scores_neither_overflow_nor_vanish(scale, monkeypatch):
    taken = []
    monkeypatch.setattr(block_attention, "below_maximum", lambda *x, real=block_attention.below_maximum:
                        taken.append(1) or real(*x))
    q, k, v = sequence(1200, seed=1, scale=scale)
    actual = window_sink_attention(q, k, v, 100, 64)
    torch.testing.assert_close(actual, masked_reference(q, k, v, 100, 64), atol=2e-5 * max(scale, 1), rtol=1e-4)
    assert bool(taken) == (scale > 1)


@inference()
def test_no_score_matrix_of_the_whole_sequence_is_made(monkeypatch):
    largest = 0

    def watch(a, b, real=torch.bmm):
        nonlocal largest
        largest = max(largest, a.shape[1] * max(a.shape[2], b.shape[2]))
        return real(a, b)

    monkeypatch.setattr(torch, "bmm", watch)
    q = torch.randn(20000, 1, 4)
    window_sink_attention(q, q, q, 100, 64)
    assert 0 < largest <= inference_module.CHUNK ** 2


@inference()
def test_progress_may_cancel_inside_a_layer():
    class Cancelled(Exception):
        pass

    def callback(text, fraction):
        if fraction > 0.5:
            raise Cancelled
    q = torch.randn(3000, 1, 4)
    with pytest.raises(Cancelled), progress.reporting(callback):
        window_sink_attention(q, q, q, 10, 64)


@inference()
def test_blocks_give_the_same_as_one_and_poll_in_order():
    q, k, v = (x.transpose(0, 1) for x in sequence(1700, seed=0, heads=5, width=8))
    seen, cut = [], [(a, min(a + 300, 1700)) for a in range(0, 1700, 300)]
    keys = KeysValues([(k[:, a:b].contiguous(), v[:, a:b].contiguous()) for a, b in cut])
    with progress.reporting(lambda text, fraction: seen.append(fraction)):
        actual = attend_to_all(q[:, :70], keys)
    expected = F.scaled_dot_product_attention(q[None, :, :70], k[None], v[None])[0]
    torch.testing.assert_close(actual, expected, atol=1e-6, rtol=1e-5)
    assert len(seen) == len(cut) and seen == sorted(seen) and seen[-1] < 1


def test_rows_across_blocks_are_those_of_the_sequence():
    k = torch.arange(60.0).view(1, 20, 3)
    keys = KeysValues([(k[:, a:b], -k[:, a:b]) for a, b in ((0, 4), (4, 5), (5, 13), (13, 20))])
    assert len(keys) == 20
    for begin, end in ((0, 20), (0, 4), (3, 5), (4, 5), (5, 13), (12, 14), (19, 20)):
        rows = keys.rows(begin, end)
        assert torch.equal(rows.keys, k[:, begin:end]) and torch.equal(rows.values, -k[:, begin:end])
    for end in range(21):
        found = [block.keys for block in keys.before(end)]
        assert torch.equal(torch.cat([k[:, :0], *found], dim=1), k[:, :end])
