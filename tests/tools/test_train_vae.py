# SPDX-License-Identifier: GPL-3.0-or-later
"""`python -m tools.train.vae` makes a VAE that a published bundle can be rendered with."""
import sys

import torch

from renderformer_v2.model.published.image_encoder import ImageEncoder
from tests.model.published.bundles import tiny_published_config, write_bundle
from tests.tools.test_train_ranks import write
from tools.train import vae


def test_a_vae_is_trained_into_the_bundle_that_has_the_mappers(tmp_path, monkeypatch):
    write(tmp_path / "data", 1)
    bundle = write_bundle(tmp_path / "renderformer-v2", tiny_published_config())
    before = ImageEncoder(bundle / "vae").identity
    monkeypatch.setattr(sys, "argv", ["vae", str(tmp_path / "data"), "--bundle", str(bundle), "--work",
                                      str(tmp_path / "work"), "--steps", "2"])
    assert vae.main() == 0
    encoder = ImageEncoder(bundle / "vae")
    assert encoder.identity != before and encoder.channels == 16
    assert encoder(torch.rand(2, 3, 32, 32)).shape == (2, 16, 4, 4)


def test_a_folder_without_samples_is_said(tmp_path, monkeypatch, capsys):
    bundle = write_bundle(tmp_path / "renderformer-v2", tiny_published_config())
    monkeypatch.setattr(sys, "argv", ["vae", str(tmp_path), "--bundle", str(bundle), "--work", str(tmp_path / "work")])
    assert vae.main() == 2 and "holds no samples" in capsys.readouterr().err
