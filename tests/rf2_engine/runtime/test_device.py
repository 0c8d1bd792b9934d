# SPDX-License-Identifier: GPL-3.0-or-later
"""What a panel knows of the chosen device before PyTorch was asked, and what PyTorch then says."""
import sys

import pytest

from bl_ext.user_default.renderformer_v2.model.errors import CheckpointError
from bl_ext.user_default.renderformer_v2.rf2_engine.runtime import device
from bl_ext.user_default.renderformer_v2.rf2_engine.setup import importing, packages, wheels

from tests.described_cards import describe


@pytest.fixture(autouse=True)
def nothing_asked(monkeypatch):
    monkeypatch.setattr(device, "_answers", {})


@pytest.mark.parametrize("build, has_driver, words", [
    ("CPU", True, "choose the CUDA build"), ("CUDA 13.2", False, "No NVIDIA driver"), ("CUDA 13.2", True, ""),
    ("ROCm 7.1", False, ""), ("", False, "")])  # packages that are missing are said elsewhere
def test_panels_guess_whether_cuda_is_there_without_importing_pytorch(monkeypatch, build, has_driver, words):
    monkeypatch.setattr(packages, "installed_build", lambda: build)
    monkeypatch.setattr(wheels, "has_nvidia_driver", lambda: has_driver)
    monkeypatch.setattr(importing, "import_packages", lambda: pytest.fail("a panel imports PyTorch"))
    problem = device.find_problem("cuda:1")
    assert words in problem if words else not problem
    assert not device.find_problem("auto") and not device.find_problem("cpu")
    assert bool(device.find_problem("mps")) == (sys.platform != "darwin")


def test_what_pytorch_says_replaces_the_guess(monkeypatch):
    monkeypatch.setattr(packages, "installed_build", lambda: "CUDA 13.2")
    monkeypatch.setattr(wheels, "has_nvidia_driver", lambda: True)
    describe(monkeypatch, driver=12040)
    with pytest.raises(CheckpointError, match="driver is too old.*Update the driver, or set Device to Automatic"):
        device.require("cuda")
    assert "driver is too old" in device.find_problem("cuda")
    describe(monkeypatch, ("GeForce RTX 3070", (8, 6), 8))
    device.require("cuda")
    assert not device.find_problem("cuda")
