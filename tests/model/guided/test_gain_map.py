# SPDX-License-Identifier: GPL-3.0-or-later
"""The gain map starts with no say, and looks at about as many cells of a picture whatever its size."""
import pytest
import torch

from renderformer_v2.model.guided import guide_tensors as guides_module
from renderformer_v2.model.guided.decoding import OUTPUTS, SEEN, decode_light, light_cells
from renderformer_v2.model.guided.gain_map import CELLS, GainMap, cell_side
from renderformer_v2.model.guided.guide_tensors import FEATURES
from tests.model.guided.test_guide_tensors import tensors


def test_an_untrained_gain_map_changes_nothing():
    assert (GainMap(5, 4, 3)(torch.randn(1, 5, 16, 16)) == 0).all()


def test_what_it_sees_is_standardised():
    cells = torch.randn(6, 5, 8, 8) * torch.tensor([1e-2, 1, 5, 100, 0])[:, None, None] + 3
    gain_map = GainMap(5, 4, 3)
    gain_map.standardise(cells)
    seen = cells * gain_map.scale[:, None, None] + gain_map.offset[:, None, None]
    torch.testing.assert_close(seen.mean((0, 2, 3)), torch.zeros(5), atol=1e-3, rtol=0)
    torch.testing.assert_close(seen.std((0, 2, 3))[:4], torch.ones(4))


def test_what_fills_the_picture_counts_everywhere():
    torch.manual_seed(0)
    gain_map = GainMap(5, 4, 3).eval()
    torch.nn.init.normal_(gain_map.leave.weight)
    cells = torch.randn(1, 5, 40, 40, requires_grad=True)
    gain_map(cells)[..., 0, 0].sum().backward()
    assert cells.grad[..., -1, -1].abs().sum() > 0


@pytest.mark.parametrize("size, side", [((128, 128), 4), ((64, 192), 4), ((448, 512), 16), ((4096, 2048), 64)])
def test_cells_grow_with_the_picture_and_fill_it(size, side):
    assert cell_side(*size) == side and size[0] % side == size[1] % side == 0
    assert CELLS <= max(size) // side < 2 * CELLS or side == 64


@torch.no_grad()
@pytest.mark.parametrize("hinted", [True, False])
def test_a_gain_is_a_factor_of_all_light(hinted):
    guides, raw = tensors(hinted=hinted), torch.randn(1, len(OUTPUTS), 64, 64)
    raw[:, OUTPUTS["gain"]] = 0
    plain = decode_light(raw, guides)
    raw[:, OUTPUTS["gain"]] = 0.1
    brighter = decode_light(raw, guides)
    factor = (brighter["image"] / plain["image"])[plain["image"] > 0]
    assert factor.min() > 1.1 and factor.max() - factor.min() < 1e-4
    for key, light in plain.items():
        torch.testing.assert_close(brighter[key], light * factor[0])


@torch.no_grad()
def test_bands_of_a_large_picture_change_nothing(monkeypatch):
    guides, raw = tensors(64, 128, hinted=True), torch.randn(1, len(OUTPUTS), 128, 64)
    whole = light_cells(raw, guides)
    monkeypatch.setattr(guides_module, "BAND_PIXELS", 1)
    assert torch.equal(light_cells(raw, guides), whole)


@torch.no_grad()
def test_cells_are_means_of_features_and_of_light():
    guides, raw = tensors(128, 64, hinted=True), torch.zeros(1, len(OUTPUTS), 64, 128)
    cells = light_cells(raw, guides)
    assert cells.shape == (1, len(SEEN), 16, 32)
    expected = guides.features[:, FEATURES["roughness"], :4, :4].mean()
    torch.testing.assert_close(cells[0, SEEN.index("roughness"), 0, 0], expected)
    assert torch.equal(cells[:, SEEN["image"]], cells[:, SEEN["begun"]])  # what the decoder says is nothing yet
