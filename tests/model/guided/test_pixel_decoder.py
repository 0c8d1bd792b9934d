# SPDX-License-Identifier: GPL-3.0-or-later
"""Convolutions of full and of half resolution give channels of pixels, in bands as in one."""
import pytest
import torch

from renderformer_v2.model.guided.pixel_decoder import PixelDecoder
from renderformer_v2.model.pictures import bands


@pytest.fixture(params=[0, 8], ids=["alone", "with coarse layers"])
def decoder(request):
    torch.manual_seed(0)
    return PixelDecoder(3, 8, 5, request.param)


def trained(decoder):
    for p in decoder.parameters():
        torch.nn.init.normal_(p, std=0.2)
    return decoder


def test_it_gives_zeros_before_it_is_trained(decoder):
    assert not decoder(torch.randn(1, 3, 16, 24)).any()


@torch.no_grad()
def test_new_coarse_layers_change_nothing():
    old, new = trained(PixelDecoder(3, 8, 5)), PixelDecoder(3, 8, 5, coarse_width=8)
    new.load_state_dict(old.state_dict(), strict=False)
    picture = torch.randn(1, 3, 16, 24)
    assert old(picture).std() > 0.1 and torch.equal(old(picture), new(picture))


@torch.no_grad()
def test_bands_with_its_reach_around_them_give_the_same(decoder):
    picture = torch.randn(1, 3, 200, 16)
    whole = trained(decoder)(picture)
    parts = [decoder(picture[..., outer, :])[..., inner, :]
             for outer, inner in bands(200, 16, margin=decoder.reach, pixels=40 * 16, multiple=2)]
    assert len(parts) == 5
    torch.testing.assert_close(torch.cat(parts, -2), whole, atol=1e-5, rtol=1e-4)


@torch.no_grad()
@pytest.mark.parametrize("coarse_width", [0, 8])
def test_pixels_beyond_its_reach_change_nothing(coarse_width):
    decoder = trained(PixelDecoder(3, 8, 5, coarse_width))
    picture = torch.randn(1, 3, 16, 200)
    other = picture.clone()
    other[..., 100 + decoder.reach:] += 1
    assert torch.equal(decoder(picture)[..., :100], decoder(other)[..., :100])
    assert not torch.equal(decoder(picture)[..., :125], decoder(other)[..., :125])
