# SPDX-License-Identifier: GPL-3.0-or-later
"""The material autoencoder at its published and at a small size."""
import torch

from renderformer_v2.model.material.autoencoder import MaterialAutoencoder, inverse_log10_1p, log10_1p


def test_published_size():
    with torch.device("meta"):
        state = MaterialAutoencoder().state_dict()
    assert len(state) == 194 and sum(v.numel() for v in state.values()) == 36_016_140


def test_small_version_maps_spheres_to_latents_and_back():
    model = MaterialAutoencoder(image_size=64, widths=(64, 48, 32), residual_blocks=2, groups=8)
    images = log10_1p(torch.rand(2, 3, 64, 64))
    latents = model.encode(images)
    assert latents.shape == (2, 9) and model.decode(latents).shape == images.shape
    torch.testing.assert_close(log10_1p(inverse_log10_1p(images)), images)
