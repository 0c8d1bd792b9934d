# SPDX-License-Identifier: GPL-3.0-or-later
"""`python -m tools.verify_path`: what it measures, packs and begins with."""
import argparse

import numpy as np
import pytest
import torch

from renderformer_v2.model.published.bundle import load_transformer
from renderformer_v2.model.published.bundle_files import check_weights
from tests.model.published.bundles import tiny_published_config, write_bundle
from tests.tools.test_train_ranks import write
from tools.verify_path.__main__ import choose_start
from tools.verify_path.bundle import COMMITTED, begin, pack, tiny_config
from tools.verify_path.measure import grey, measure

MOST = 20e6  # bytes of the bundle in the repository


def test_a_packed_bundle_is_complete_and_half_as_large(tmp_path):
    bundle = write_bundle(tmp_path / "renderformer-v2", tiny_published_config())
    pack(bundle, tmp_path / "packed")
    pack(bundle, tmp_path / "packed")
    check_weights(tmp_path / "packed")
    sizes = [(folder / "transformer_512" / "model.safetensors").stat().st_size
             for folder in (bundle, tmp_path / "packed")]
    assert sizes[1] < 0.6 * sizes[0]
    before, after = (load_transformer(folder / "transformer_512") for folder in (bundle, tmp_path / "packed"))
    assert before.config == after.config
    for (name, a), b in zip(before.state_dict().items(), after.state_dict().values(), strict=True):
        torch.testing.assert_close(a, b, rtol=0 if name.endswith("freqs") else 1e-3, atol=1e-6)


def test_the_bundle_of_the_repository_is_small_and_of_the_published_format():
    check_weights(COMMITTED)
    assert sum(path.stat().st_size for path in COMMITTED.rglob("*")) < MOST
    assert load_transformer(COMMITTED / "transformer_512").config == tiny_config()


@pytest.mark.parametrize("anew, begun", [(False, False), (False, True)])
def test_training_begins_with_the_bundle_of_the_repository_unless_another_was_begun(tmp_path, anew, begun):
    if begun:
        begin(tmp_path / "start")
        for name in ("diffspec_mapper", "metallic_mapper"):
            (tmp_path / "start" / name).mkdir()
            for file in ("config.json", "model.safetensors"):
                (tmp_path / "start" / name / file).touch()
        (tmp_path / "start" / "vae").mkdir()
    start = choose_start(argparse.Namespace(work=tmp_path, anew=anew))
    assert start == (tmp_path / "start" if begun else COMMITTED)


def test_pictures_are_measured_beside_grey_ones(tmp_path):
    write(tmp_path / "data", 1)
    bundle = write_bundle(tmp_path / "renderformer-v2", tiny_published_config())
    mean = measure(tmp_path / "data", bundle, tmp_path / "report")
    assert np.isfinite([mean["psnr"], mean["grey"]["psnr"]]).all()
    assert "a grey picture" in (tmp_path / "report" / "report.html").read_text()


def test_grey_is_as_bright_as_the_picture():
    picture = np.random.default_rng(0).uniform(size=(4, 5, 3)).astype(np.float32)
    assert grey(picture).shape == picture.shape and np.ptp(grey(picture)) == 0
    assert grey(picture).mean() == pytest.approx(picture.mean(), rel=1e-5)
