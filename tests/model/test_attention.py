# SPDX-License-Identifier: GPL-3.0-or-later
"""Window + sink attention against a dense mask."""
import pytest
import torch
from torch.nn import functional as F

from model.attention import dense_attention, window_sink_attention


def masked_reference(q, k, v, sink, half):
    index = torch.arange(q.shape[1])
    visible = (index[:, None] - index).abs() <= half
    visible[:sink], visible[:, :sink] = True, True
    return F.scaled_dot_product_attention(q[None], k[None], v[None], attn_mask=visible)[0]


SIZES = [(1, 0, 2), (9, 9, 2), (12, 3, 2), (40, 0, 3), (300, 7, 1), (513, 0, 256), (600, 20, 256), (700, 30, 8),
         (1339, 102, 256), (1000, 5, 300), (257, 1, 255), (262, 5, 256)]


@pytest.mark.parametrize("length, sink, half", SIZES)
@pytest.mark.parametrize("dtype, tolerance", [(torch.float32, 1e-5), (torch.bfloat16, 5e-2)])
def test_window_sink_attention_equals_a_dense_mask(length, sink, half, dtype, tolerance):
    q, k, v = torch.randn(3, 2, length, 16, generator=torch.Generator().manual_seed(length))
    expected = masked_reference(q, k, v, sink, half)
    actual = window_sink_attention(q.to(dtype), k.to(dtype), v.to(dtype), sink, half)
    assert actual.dtype == dtype
    torch.testing.assert_close(actual.float(), expected, atol=tolerance, rtol=tolerance)


def test_no_score_matrix_of_the_whole_sequence_is_made(monkeypatch):
    largest = 0
    attend = F.scaled_dot_product_attention

    def watch(q, k, v, attn_mask=None):
        nonlocal largest
        largest = max(largest, q.shape[-2] * k.shape[-2])
        return attend(q, k, v, attn_mask=attn_mask)

    monkeypatch.setattr(F, "scaled_dot_product_attention", watch)
    q = torch.randn(1, 20000, 4)
    window_sink_attention(q, q, q, 100, 64)
    dense_attention(q[:, :3000], q, q)
    assert largest < 2 ** 25 and largest < 20000 ** 2 / 8


def test_progress_may_cancel_inside_a_layer():
    from model.progress import Progress

    class Cancelled(Exception):
        pass

    def callback(text, fraction):
        if fraction > 0.5:
            raise Cancelled
    q = torch.randn(1, 3000, 4)
    with pytest.raises(Cancelled):
        window_sink_attention(q, q, q, 10, 64, Progress(callback))


def test_a_few_heads_at_a_time_give_the_same_and_poll_in_order(monkeypatch):
    from model import attention
    from model.progress import Progress
    q, k, v = torch.randn(3, 5, 700, 8, generator=torch.Generator().manual_seed(0))
    expected, seen = F.scaled_dot_product_attention(q[None], k[None], v[None])[0], []
    monkeypatch.setattr(attention, "FLOPS_PER_CALL", 2 * 256 * 4 * 700 * 8)
    with torch.no_grad():
        actual = dense_attention(q, k, v, Progress(lambda text, fraction: seen.append(fraction)))
    torch.testing.assert_close(actual, expected, atol=1e-6, rtol=1e-5)
    assert len(seen) > 3 and seen == sorted(seen) and seen[-1] < 1
