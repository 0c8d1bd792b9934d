# SPDX-License-Identifier: GPL-3.0-or-later
"""A tiny network with every mechanism, and inputs for it; and scenes so small that few patches are enough."""
import pytest
import torch

from renderformer_v2.model.light.bounce import patches
from renderformer_v2.model.network.config import ModelConfig
from renderformer_v2.model.network.inputs import EnvironmentInputs, NetworkInputs, ViewInputs, VolumeInputs
from tests.model.published.bundles import tiny_published_config, write_bundle
from tools.parity.cases import recipe_network


@pytest.fixture(autouse=True)
def few_patches(monkeypatch):
    """An eighth of the patches of a picture."""
    monkeypatch.setattr(patches, "PATCHES", patches.PATCHES // 8)


@pytest.fixture(scope="session")
def tiny_config() -> ModelConfig:
    return tiny_published_config()


@pytest.fixture(scope="session")
def tiny_network(tiny_config):
    return recipe_network(tiny_config)


@pytest.fixture
def tiny_inputs() -> NetworkInputs:
    generator = torch.Generator().manual_seed(1)

    def random(*shape):
        return torch.randn(*shape, generator=generator)

    light = torch.zeros(50, 3)
    light[[7, 30]] = 2.0
    triangles = random(50, 1, 3) / 4 + random(50, 3, 3) / 50
    return NetworkInputs(
        triangles, torch.nn.functional.normalize(random(50, 3, 3), dim=-1), random(5, 4, 4, 4),
        torch.arange(50) % 5, light, EnvironmentInputs(random(2, 32, 64), random(2, 32, 64), torch.ones(1)),
        VolumeInputs(random(6, 64), random(6, 3) / 4, random(6, 3), random(6, 3), random(6, 3), random(6, 3)))


@pytest.fixture
def rays() -> ViewInputs:
    directions = torch.randn(2, 64, 64, 3, generator=torch.Generator().manual_seed(2))
    directions = torch.nn.functional.normalize(directions, dim=-1)
    return ViewInputs(torch.tensor([[0.0, 0.0, 2.0], [1.0, -1.0, 0.5]]), directions)


@pytest.fixture(scope="session")
def published_bundle(tmp_path_factory, tiny_config):
    return write_bundle(tmp_path_factory.mktemp("published") / "renderformer-v2", tiny_config)
