# SPDX-License-Identifier: GPL-3.0-or-later
"""LPIPS as its authors define it, with made up weights: the real ones are downloads."""
import pytest
import torch
from torch.nn import functional as F

from renderformer_v2.model.errors import CheckpointError
from tests.tools.lpips_weights import write_weights
from tools.common.lpips import BACKBONES, Lpips, load_lpips

# Layers of torchvision's networks whose results LPIPS compares, and what the distance of each is of
TAPS = {"vgg": ("relu1_2", "relu2_2", "relu3_3", "relu4_3", "relu5_3"), "alex": ("relu1", "relu2", "relu3", "relu4",
                                                                               "relu5")}
PARAMETERS = {"vgg": 14_714_688, "alex": 2_469_696}  # of torchvision's convolutions


@pytest.mark.parametrize("backbone", BACKBONES)
def test_the_files_of_torchvision_and_of_the_authors_are_read(tmp_path, backbone):
    expected = write_weights(tmp_path, backbone)
    found = load_lpips(backbone, tmp_path)
    assert sum(p.numel() for p in found.features.parameters()) == PARAMETERS[backbone]
    assert len(found.taps) == len(TAPS[backbone])
    a, b = torch.rand(2, 2, 3, 64, 64).unbind(0)
    assert torch.equal(found(a, b), expected(a, b)) and (found(a, b) > 0).all()
    torch.testing.assert_close(found(a, a), torch.zeros(2))


def test_the_distance_is_that_of_unit_features():
    """By the definition, for the first compared layer of VGG."""
    network = Lpips("vgg").eval()
    with torch.no_grad():
        for i, p in enumerate(network.weights):
            p.fill_(float(i == 0))
        a, b = torch.rand(2, 1, 3, 32, 32).unbind(0)
        shift, scale = torch.tensor([-.030, -.088, -.188]), torch.tensor([.458, .448, .450])
        features = [network.features[:4]((2 * x - 1 - shift.view(3, 1, 1)) / scale.view(3, 1, 1)) for x in (a, b)]
        difference = F.normalize(features[0], dim=1) - F.normalize(features[1], dim=1)
        torch.testing.assert_close(network(a, b), difference.square().sum(1).mean((1, 2)), rtol=1e-4, atol=1e-6)


def test_without_weights_there_is_no_metric(tmp_path):
    assert load_lpips("vgg", tmp_path) is None


def test_files_of_something_else_are_named(tmp_path):
    write_weights(tmp_path, "vgg")
    torch.save({"lin0.model.1.weight": torch.ones(1, 64, 1, 1)}, tmp_path / "vgg.pth")
    with pytest.raises(CheckpointError, match="vgg.pth are not the weights of LPIPS .*weights.1"):
        load_lpips("vgg", tmp_path)
    (tmp_path / "vgg.pth").write_bytes(b"no weights")
    with pytest.raises(CheckpointError, match="vgg.pth cannot be read"):
        load_lpips("vgg", tmp_path)
