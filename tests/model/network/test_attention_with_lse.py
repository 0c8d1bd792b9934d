# SPDX-License-Identifier: GPL-3.0-or-later
"""Attention with the log-sum-exp of its scores, and its merge, against float64."""
import pytest
import torch

from renderformer_v2.model.network import attention_with_lse as module
from renderformer_v2.model.network.attention_with_lse import (
    attention_with_lse,
    flash,
    is_right,
    memory_efficient,
    merged,
    plain,
)
from tests.model.card_kernels import CardKernels, pretend


def case(n=37, m=53, width=20, several=3, heads=2):
    generator = torch.Generator().manual_seed(n + m)
    q, k, v = (2 * torch.randn(several, heads, rows, width, generator=generator) for rows in (n, m, m))
    hidden = torch.rand(several, 1, n, m, generator=generator) < 0.5
    hidden[..., 0] = False
    return q, k, v, torch.zeros(hidden.shape).masked_fill_(hidden, -torch.inf)


def reference(q, k, v, bias=None):
    scores = q.double() @ k.double().transpose(2, 3) * q.shape[-1] ** -0.5 + (0 if bias is None else bias.double())
    return (scores.softmax(-1) @ v.double()).float(), scores.logsumexp(-1).float()


def assert_close(found, expected, tolerance=1e-5):
    for x, y in zip(found, expected, strict=True):
        torch.testing.assert_close(x.float(), y, atol=tolerance, rtol=tolerance)


@pytest.mark.parametrize("scores", [1, 53 * 2 * 5, 53 * 2 * 37 * 2, 1 << 25])
@pytest.mark.parametrize("biased", [False, True])
def test_plain_attention_in_pieces(scores, biased, monkeypatch):
    monkeypatch.setattr(module, "SCORES", scores)
    q, k, v, bias = case()
    assert_close(plain(q, k, v, bias if biased else None), reference(q, k, v, bias if biased else None))


@pytest.mark.parametrize("biased", [False, True])
@pytest.mark.parametrize("width", [5, 16, 20])
def test_kernels_get_what_they_can_take(width, biased, monkeypatch):
    kernels = pretend(monkeypatch)
    q, k, v, bias = case(width=width)
    bias = bias if biased else None
    assert_close(attention_with_lse(q, k, v, bias), reference(q, k, v, bias))
    assert [name for name, _ in kernels.calls] == ["efficient" if biased else "flash"]
    assert_close(memory_efficient(q, k, v, bias), reference(q, k, v, bias))


@pytest.mark.parametrize("offset", [0.0, 2.0, -2.0], ids=["as much", "more", "less"])
@pytest.mark.parametrize("dtype, tolerance", [(torch.float32, 1e-5), (torch.bfloat16, 5e-2)])
def test_two_groups_of_keys_merged_are_all_of_them(dtype, tolerance, offset):
    q, k, v, bias = case(several=1)
    k[:, :, 20:] += offset * torch.sign(q.mean(2, keepdim=True))  # the second group weighs more, or less
    q, k, v, bias = (x.to(dtype) for x in (q, k, v, bias))
    bias[..., 20] = 0
    parts = [plain(q, k[:, :, cut], v[:, :, cut], bias[..., cut]) for cut in (slice(0, 20), slice(20, None))]
    found, (expected, _) = merged(*parts), reference(q, k, v, bias)
    assert found.dtype == dtype
    torch.testing.assert_close(found.float(), expected, atol=tolerance, rtol=tolerance)


class Wrong(CardKernels):
    """Kernels of another PyTorch: `change` says how they differ."""

    def __init__(self, change):
        super().__init__()
        self.change = change

    def _scaled_dot_product_flash_attention(self, *given, **options):
        return self.change(*super()._scaled_dot_product_flash_attention(*given, **options)[:2])

    def _scaled_dot_product_efficient_attention(self, *given, **options):
        return self.change(*super()._scaled_dot_product_efficient_attention(*given, **options)[:2])


def fail(output, lse):
    raise RuntimeError("FlashAttention only supports Ampere GPUs or newer")


@pytest.mark.parametrize("change, right", [
    (lambda output, lse: (output, lse), True), (lambda output, lse: (output.bfloat16(), lse), True),
    (lambda output, lse: (output, lse * 1.4427), False), (lambda output, lse: (output, lse.roll(1, 2)), False),
    (lambda output, lse: (output, lse.transpose(1, 2)), False), (lambda output, lse: (1.2 * output, lse), False),
    (lambda output, lse: (output, lse * torch.nan), False), (lambda output, lse: (output,), False), (fail, False)],
    ids=["right", "rounded", "binary", "rolled", "transposed", "scaled", "not a number", "without", "refused"])
@pytest.mark.parametrize("kernel", [flash, memory_efficient])
@pytest.mark.parametrize("width", [20, 128])
@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16, torch.float16])
def test_a_kernel_is_used_only_where_it_is_right(kernel, width, dtype, change, right, monkeypatch):
    monkeypatch.setattr(module, "operators", lambda: Wrong(change))
    assert is_right.__wrapped__(kernel, torch.device("cpu"), dtype, width) == right


def test_without_kernels_attention_is_computed_plainly():
    q, k, v, bias = case()
    assert not is_right(flash, q.device, q.dtype, 20) and not is_right(memory_efficient, q.device, q.dtype, 20)
    assert_close(attention_with_lse(q, k, v, bias), reference(q, k, v, bias))


def test_a_card_without_memory_is_not_taken_for_one_without_kernels(monkeypatch):
    def exhausted(output, lse):
        raise torch.OutOfMemoryError("CUDA out of memory")
    monkeypatch.setattr(module, "operators", lambda: Wrong(exhausted))
    with pytest.raises(torch.OutOfMemoryError):
        is_right.__wrapped__(flash, torch.device("cpu"), torch.float32, 16)
