# SPDX-License-Identifier: GPL-3.0-or-later
"""The kernel predictor is trained alone, from what the rest of the network renders; without Blender."""
from dataclasses import replace

import numpy as np
import pytest
import torch

from renderformer_v2.model.guided.kernels import (
    CENTER,
    INPUTS,
    KernelPredictor,
    apply_kernels,
    kernel_inputs,
    picture_exposure,
)
from renderformer_v2.model.guided.network import load_network
from renderformer_v2.model.renderer import Renderer
from renderformer_v2.model.weights.presets import BUNDLED, weights_folder
from tests.model.guided.weights import busy_network, write
from tests.tools.test_train import stored  # noqa: F401 - a fixture
from tools.datagen.sample_files import load_sample, save_sample
from tools.train import antialiasing as training
from tools.train.antialiasing import CHANNELS
from tools.train.errors import SampleError


@torch.inference_mode()
def test_a_sample_becomes_what_the_predictor_sees_and_what_it_should_make(stored, tmp_path):  # noqa: F811
    renderer = Renderer(device="cpu", precision="fp32")
    scene, (view,), (guide,), (reference,) = load_sample(stored)
    guide = replace(guide, traced=np.float32(0.5) * guide.diffuse_color)
    traced = tmp_path / "scene_00000001.npz"
    save_sample(traced, scene, [view], [guide], [reference], hints=32)
    scene, (view,), (guide,), (reference,) = load_sample(traced)
    found = training.render_sample(renderer, traced)
    radiance = renderer.encode(scene).view(view, guide)
    exposure = picture_exposure(radiance, guide)
    assert found.shape == (2, sum(CHANNELS), view.height, view.width)
    known, ours, wanted = found.split(CHANNELS, 1)
    whole = exposure * (radiance + guide.emission + guide.environment)
    np.testing.assert_allclose(ours[0, :3].permute(1, 2, 0), whole, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(wanted[0, :3].permute(1, 2, 0), exposure * (
        reference["combined"][..., :3] + reference["environment"]), rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(ours[0, 3], guide.alpha)
    np.testing.assert_array_equal(wanted[0, 3], reference["combined"][..., 3])
    torch.testing.assert_close(known[:1], kernel_inputs(radiance, guide, exposure, 32))
    alone = replace(guide, traced=None)
    assert not known[1, INPUTS["traced"]].any() and known[0, INPUTS["traced"]].any()
    radiance = renderer.encode(scene).view(view, alone)
    torch.testing.assert_close(known[1:], kernel_inputs(radiance, alone, picture_exposure(radiance, alone), 32))


def test_a_damaged_sample_is_named(tmp_path):
    (tmp_path / "scene_00000002.npz").write_bytes(b"no sample")
    with pytest.raises(SampleError, match="scene_00000002.npz"):
        training.render_sample(None, tmp_path / "scene_00000002.npz")


def test_noise_of_a_pixel_is_learnt_to_be_taken_out():
    torch.manual_seed(0)
    samples = []
    for _ in range(8):
        wanted = torch.full((1, 4, 64, 64), 0.5)
        ours = wanted + 0.05 * torch.randn(1, 4, 64, 64)
        samples.append(torch.cat([torch.randn(1, CHANNELS[0], 64, 64) * 0.1, ours, wanted], 1).half())
    predictor, written = KernelPredictor(8), []
    training.train(predictor, samples, 4.0, lambda: written.append(1))
    known, ours, wanted = samples[0].float().split(CHANNELS, 1)
    with torch.no_grad():
        found = apply_kernels(ours, predictor(known))
    assert written and (found - wanted).square().mean() < 0.9 * (ours - wanted).square().mean()


def test_a_trained_predictor_goes_on_from_what_it_knows_and_an_untrained_one_is_made_ready_to_learn():
    samples = [torch.zeros(1, sum(CHANNELS), 64, 64).half()]
    untrained, trained = KernelPredictor(8), KernelPredictor(8)
    torch.nn.init.normal_(trained.leave.weight)
    before = {name: value.clone() for name, value in trained.state_dict().items()}
    for predictor in (untrained, trained):
        training.train(predictor, samples, 1e-9, lambda: None)
    assert all(torch.equal(value, before[name]) for name, value in trained.state_dict().items())
    assert untrained.leave.bias[CENTER] == training.CENTRE_LOGIT


def test_the_command_says_what_is_missing(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("sys.argv", ["antialiasing", "--data", str(tmp_path), "--out", str(tmp_path), "--minutes", "1"])
    assert training.main() == 2 and "tools.datagen" in capsys.readouterr().err


def test_pictures_without_room_for_a_part_are_named(stored, tmp_path, capsys, monkeypatch):  # noqa: F811
    monkeypatch.setattr(training, "SIDE", 100)
    monkeypatch.setattr("sys.argv", ["antialiasing", "--data", str(stored.parent), "--out", str(tmp_path / "out"),
                                     "--rendered", str(tmp_path / "rendered"), "--minutes", "1", "--processes", "1"])
    assert training.main() == 2 and "smaller than 100 pixels" in capsys.readouterr().err


@pytest.mark.parametrize("is_whole", [True, False])
def test_a_folder_of_the_same_kind_is_written_and_trained_further(stored, tmp_path, monkeypatch, is_whole):  # noqa: F811
    monkeypatch.setattr(training, "LEARNING_RATE", 0.05)  # a single step shows in half floats
    monkeypatch.setattr(training, "WARM_UP", 1)
    before = write(tmp_path / "start", busy_network()) if is_whole else weights_folder(BUNDLED)
    for name in ("first", "second"):
        out = tmp_path / name
        monkeypatch.setattr("sys.argv", ["antialiasing", "--data", str(stored.parent), "--start", str(before), "--out",
                                         str(out), "--rendered", str(tmp_path / "rendered"), "--minutes", "0.01",
                                         "--processes", "1"])
        assert training.main() == 0
        (was, config), (now, same) = ((network.state_dict(), network.config)
                                      for network in map(load_network, (before, out / "weights")))
        assert set(was) == set(now) and config == same
        assert all(torch.equal(now[key], was[key]) != key.startswith("kernel_predictor.") for key in was)
        before = out / "weights"
    assert (Renderer(before, device="cpu", precision="fp32").pipeline.transformer is not None) == is_whole
