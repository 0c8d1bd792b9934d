# SPDX-License-Identifier: GPL-3.0-or-later
"""Decoding in bands gives the pixels of decoding at once."""
import pytest
import torch

from renderformer_v2.model import progress
from renderformer_v2.model.compute.inference import inference
from renderformer_v2.model.network import banded, decoder
from renderformer_v2.model.network.decoder import DPTDecoder
from renderformer_v2.model.network.layers import in_precision
from tools.parity.cases import with_recipe_weights


def features(views: int, grid: tuple[int, int], channels: int = 5):
    generator = torch.Generator().manual_seed(grid[0])
    extra = torch.randn(views, channels, 8 * grid[0], 8 * grid[1], generator=generator)
    return [torch.randn(views, 48, *grid, generator=generator) for _ in range(4)], extra


def built(config) -> DPTDecoder:
    return with_recipe_weights(DPTDecoder(config, extra_channels=5))


@inference()
@pytest.mark.parametrize("views, grid, rows", [(1, (8, 8), 8), (1, (24, 8), 16), (2, (16, 24), 24), (1, (40, 8), 104),
                                               (1, (8, 16), 40), (1, (64, 8), 8)])
def test_bands_equal_the_whole_picture(tiny_config, monkeypatch, views, grid, rows):
    network, (levels, extra), bands = built(tiny_config), features(views, grid), []
    expected = network(levels, extra)
    monkeypatch.setattr(decoder, "BAND_PIXELS", rows * 8 * grid[1] * views)
    monkeypatch.setattr(banded.Rows, "tensor", lambda picture, count, real=banded.Rows.tensor:
                        bands.append(count) or real(picture, count))
    actual = network(levels, extra)
    assert bands == ([rows] if rows < 8 * grid[0] else [])
    assert (actual - expected).abs().max() <= 1e-6 * expected.abs().max()


@inference()
def test_bands_agree_in_bfloat16(tiny_config, monkeypatch):
    network, (levels, extra) = in_precision(built(tiny_config), torch.bfloat16), features(1, (16, 8))
    expected = network(levels, extra)
    assert expected.dtype == torch.float32 and (expected.bfloat16() != expected).any()
    monkeypatch.setattr(decoder, "BAND_PIXELS", 16 * 64)
    assert (network(levels, extra) - expected).abs().max() <= 2e-2 * expected.abs().max()


@inference()
def test_a_band_can_be_cancelled_and_progress_rises(tiny_config, monkeypatch):
    network, (levels, extra), seen = built(tiny_config), features(1, (16, 8)), []
    monkeypatch.setattr(decoder, "BAND_PIXELS", 16 * 64)
    with progress.reporting(lambda text, fraction: seen.append(fraction)):
        network(levels, extra)
    assert seen == sorted(seen) and seen[0] == 0 and 0.8 < seen[-1] <= 1

    def cancel(text, fraction):
        if fraction > 0.5:
            raise InterruptedError
    with pytest.raises(InterruptedError), progress.reporting(cancel):
        network(levels, extra)


def test_gradients_are_never_tiled(tiny_config, monkeypatch):
    network, (levels, extra) = built(tiny_config), features(1, (8, 8))
    monkeypatch.setattr(decoder, "BAND_PIXELS", 1)
    levels[0].requires_grad_()
    network(levels, extra).sum().backward()
    assert levels[0].grad.any()
