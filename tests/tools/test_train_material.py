# SPDX-License-Identifier: GPL-3.0-or-later
"""`python -m tools.train.material` says in one sentence what is wrong with its data."""
import sys

import numpy as np
import pytest

from tools.datagen.sample_files import save_arrays
from tools.train import material
from tools.train.errors import TrainingError


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    def run() -> str:
        """What is said about the folder "spheres"."""
        monkeypatch.setattr(sys, "argv", ["material", str(tmp_path / "spheres"), "--work", str(tmp_path / "work"),
                                          "-o", str(tmp_path / "out"), "--mapper-steps", "1", "--encoder-steps", "1"])
        assert material.main() == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1 and not (tmp_path / "out").exists()
        return said
    return run


def test_a_mistyped_folder(run):
    assert "there is no folder" in run()


@pytest.mark.parametrize("count", [0, 1, material.HELD_OUT])
def test_a_folder_with_too_little(run, tmp_path, count):
    (tmp_path / "spheres").mkdir()
    if count:
        save_arrays(tmp_path / "spheres" / "spheres_00000001.npz", {
            "parameters": np.zeros((count, 7), np.float32), "images": np.zeros((count, 64, 64, 3), np.float16)})
    assert f"holds {count} spheres" in run()


def test_a_broken_file_is_named(run, tmp_path):
    (tmp_path / "spheres").mkdir()
    (tmp_path / "spheres" / "spheres_00000001.npz").write_text("junk")
    assert "spheres_00000001.npz cannot be read" in run()


def test_training_that_goes_wrong(run, monkeypatch):
    def fail(folder):
        raise TrainingError("the gradients are not finite")

    monkeypatch.setattr(material, "load_spheres", fail)
    assert run() == "the gradients are not finite\n"
