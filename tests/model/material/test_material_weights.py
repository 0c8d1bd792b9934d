# SPDX-License-Identifier: GPL-3.0-or-later
"""The bundled mapper tells materials apart: what it merges, the network can never see."""
import pytest
import torch

from renderformer_v2.model.material.autoencoder import MaterialAutoencoder
from renderformer_v2.model.material.mappers import MATERIAL_MAPPER, load_material_mapper
from renderformer_v2.model.weights.checkpoint import load_component

GREY = (0.5, 0.5, 0.5, 0.0, 0.3, 1.5, 0.0)  # base R, G, B; metallic; roughness; index of refraction; transmission


@pytest.mark.parametrize("change, least", [
    ({0: 0.9, 2: 0.1}, 0.15), ({0: 0.1, 2: 0.9}, 0.15), ({0: 0.9, 1: 0.9, 2: 0.9}, 0.15), ({3: 1.0}, 0.15),
    ({4: 0.03}, 0.15), ({4: 1.0}, 0.15), ({6: 1.0}, 0.15), ({5: 2.0}, 0.05)],
    ids=["red", "blue", "white", "metal", "polished", "matt", "glass", "dense"])
def test_each_parameter_moves_the_latent(change, least):
    other = [change.get(i, value) for i, value in enumerate(GREY)]
    with torch.no_grad():
        latents = load_material_mapper()(torch.tensor([GREY, other]))
    assert latents.shape == (2, 9) and latents.abs().max() <= 1
    assert (latents[0] - latents[1]).abs().mean() > least


def test_the_autoencoder_pictures_what_the_mapper_means_and_finds_its_latent_again():
    autoencoder = load_component(MaterialAutoencoder, MATERIAL_MAPPER.parent / "material_autoencoder")
    red, blue = ([{0: 0.9, 1: 0.1, 2: 0.1}.get(i, v) for i, v in enumerate(GREY)],
                 [{0: 0.1, 1: 0.1, 2: 0.9}.get(i, v) for i, v in enumerate(GREY)])
    with torch.no_grad():
        latents = load_material_mapper()(torch.tensor([red, blue]))
        pictures = autoencoder.decode(latents)
        found = autoencoder.encode(pictures)
    mean = pictures.mean((2, 3))
    assert mean[0, 0] > 1.5 * mean[0, 2] and mean[1, 2] > 1.5 * mean[1, 0]
    assert (found - latents).abs().mean() < 0.3 * (latents[0] - latents[1]).abs().mean()
