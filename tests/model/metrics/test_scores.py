# SPDX-License-Identifier: GPL-3.0-or-later
"""Our PSNR, SSIM and FLIP give the libraries' numbers; noise of a reference is told from a wrong picture of it."""
import flip_evaluator
import matplotlib
import numpy as np
import pytest
import torch
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from renderformer_v2.model import pictures, progress
from renderformer_v2.model.metrics import flip
from renderformer_v2.model.metrics import scores as metrics
from renderformer_v2.model.metrics.scores import excess_noise, lpips


def _picture(seed: int, height=90, width=130) -> np.ndarray:
    """Smooth colours with a bright disc, some noise, and a black and a white corner."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:height, :width] / height
    picture = 0.5 + 0.4 * np.sin(np.stack([5 * x + seed, 4 * y, 3 * (x + y)], -1))
    picture[np.hypot(x - 0.7, y - 0.5) < 0.2] = (0.95, 0.8, 0.1)
    picture += rng.normal(0, 0.02 * (seed + 1), picture.shape)
    picture[:5, :5], picture[-5:, -5:] = 0, 1
    return np.clip(picture, 0, 1).astype(np.float32)


PAIRS = {"noise": (_picture(0), np.clip(_picture(0) + 0.05 * (_picture(3) - 0.5), 0, 1)),
         "other picture": (_picture(0), _picture(1)),
         "opposite colours": (_picture(0), 1 - _picture(0)),
         "small": (_picture(0, 8, 31), _picture(1, 8, 31))}


@pytest.fixture(params=PAIRS)
def pair(request):
    return PAIRS[request.param]


def test_psnr_is_scikit_images(pair):
    assert metrics.psnr(*pair) == pytest.approx(peak_signal_noise_ratio(*pair, data_range=1.0), abs=1e-4)


def test_ssim_is_scikit_images(pair):
    assert metrics.ssim(*pair) == pytest.approx(structural_similarity(*pair, channel_axis=2, data_range=1.0), abs=1e-4)


def test_flip_is_the_authors(pair):
    expected, mean, _ = flip_evaluator.evaluate(*pair, "LDR", inputsRGB=True, applyMagma=False)
    ours = flip.flip_map(*pair)
    assert ours.mean() == pytest.approx(mean, rel=1e-3)
    np.testing.assert_allclose(ours, expected[..., 0], atol=1e-2)


def test_hdr_flip_is_the_authors(pair):
    bright = [pictures.srgb_to_linear(picture) * np.float32(scale) for picture, scale in zip(pair, (20, 18))]
    expected, mean, _ = flip_evaluator.evaluate(*bright, "HDR", applyMagma=False)
    ours = flip.hdr_flip_map(*bright)
    assert ours.mean() == pytest.approx(mean, rel=2e-3)
    np.testing.assert_allclose(ours, expected[..., 0], atol=1e-2)


def test_equal_pictures_are_equal():
    picture = _picture(0)
    assert metrics.psnr(picture, picture) == pytest.approx(100)
    assert metrics.ssim(picture, picture) == pytest.approx(1)
    assert flip.flip_map(picture, picture).max() == 0 and flip.hdr_flip_map(picture, picture).max() == 0


def test_too_small_for_ssim_is_said():
    with pytest.raises(ValueError, match="7 x 7"):
        metrics.ssim(np.zeros((6, 20, 3)), np.zeros((6, 20, 3)))


def test_flip_can_be_cancelled():
    def stop(text, fraction):
        raise KeyboardInterrupt

    with progress.reporting(stop), pytest.raises(KeyboardInterrupt):
        flip.flip_map(_picture(0), _picture(1))


def test_closeness_is_that_of_srgb_encoded_pictures():
    a, b = _picture(0), _picture(1)
    close = metrics.compare(pictures.srgb_to_linear(a), pictures.srgb_to_linear(b) + np.where(b == 1, 9, 0))
    assert close.psnr == pytest.approx(metrics.psnr(a, b), abs=1e-3)
    assert close.ssim == pytest.approx(metrics.ssim(a, b), abs=1e-4)
    assert close.flip == pytest.approx(flip.flip_map(b, a).mean(), rel=1e-3)


def test_lpips_is_its_packages_where_that_is_there(tmp_path, monkeypatch):
    monkeypatch.setenv("TORCH_HOME", str(tmp_path))  # nothing was downloaded
    assert lpips(_picture(0), _picture(1)) is None
    package, torchvision = pytest.importorskip("lpips"), pytest.importorskip("torchvision")
    (tmp_path / "hub/checkpoints").mkdir(parents=True)
    file = torchvision.models.AlexNet_Weights.IMAGENET1K_V1.url.rsplit("/")[-1]
    torch.save(torchvision.models.alexnet().state_dict(), tmp_path / "hub/checkpoints" / file)
    a, b = (torch.tensor(_picture(seed)).permute(2, 0, 1)[None] * 2 - 1 for seed in (0, 1))
    expected = package.LPIPS(net="alex", verbose=False)(a, b)
    assert lpips(_picture(0), _picture(1)) == pytest.approx(expected.item(), rel=1e-4)


def test_pictures_of_different_sizes_are_refused():
    with pytest.raises(ValueError, match="20 x 9 and 30 x 8"):
        metrics.compare(np.zeros((9, 20, 3)), np.zeros((8, 30, 3)))


def test_magma_is_matplotlibs():
    values = np.linspace(0, 1, 256)
    np.testing.assert_allclose(flip.magma(values), matplotlib.colormaps["magma"](values)[:, :3], atol=2.5 / 255)


SIGMA = 0.05


@pytest.fixture
def scene():
    """(96, 128, 3): a gradient with a checkerboard texture in one half and an edge."""
    y, x = np.mgrid[:96, :128] / 96
    picture = 0.3 + 0.3 * x + 0.1 * np.sin(3 * y)
    picture[:, 64:] += 0.1 * ((np.indices((96, 64)) // 3).sum(0) % 2)
    picture[40:70, 20:50] -= 0.25
    return np.repeat(picture[..., None], 3, -1).astype(np.float32)


def noisy(picture, sigma=SIGMA):
    return picture + np.random.default_rng(3).normal(0, sigma, picture.shape).astype(np.float32)


def smoothed(picture):
    return (np.roll(picture, 1, 1) + 2 * picture + np.roll(picture, -1, 1)) / 4


def test_noise_of_the_reference_is_measured_whatever_else_is_wrong(scene):
    brighter = scene * 1.1
    assert excess_noise(brighter, noisy(scene)) == pytest.approx(SIGMA ** 2, rel=0.25)


def test_only_what_the_reference_has_more_counts(scene):
    assert excess_noise(noisy(scene), scene) == 0
    assert excess_noise(noisy(scene), noisy(scene)) == 0


def test_a_smoothed_edge_is_no_noise_of_the_other_picture(scene):
    plain = scene[:, :64]
    assert excess_noise(smoothed(plain), plain) < 0.02 * np.mean((smoothed(plain) - plain) ** 2)


def test_a_picture_that_is_too_small_tells_nothing(scene):
    assert excess_noise(scene[:20, :20], noisy(scene)[:20, :20]) == 0
