# SPDX-License-Identifier: GPL-3.0-or-later
"""`python -m tools.train.material` trains three mappers, and says in one sentence what is wrong with its data."""
import sys

import numpy as np
import pytest

from renderformer_v2.model.material.autoencoder import MaterialAutoencoder
from renderformer_v2.model.material.mappers import MAPPERS
from renderformer_v2.model.weights.checkpoint import load_component
from tools.datagen.sample_files import save_arrays
from tools.train import material
from tools.train.errors import TrainingError


def write_spheres(folder, mapper: str, count: int) -> None:
    (folder / mapper).mkdir(parents=True)
    rng = np.random.default_rng(0)
    if count:
        save_arrays(folder / mapper / "spheres_00000001.npz", {
            "parameters": rng.uniform(size=(count, MAPPERS[mapper].inputs)).astype(np.float32),
            "images": rng.uniform(size=(count, 64, 64, 3)).astype(np.float16)})


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
    write_spheres(tmp_path / "spheres", material.FIRST, count)
    assert f"holds {count} spheres" in run()


def test_a_broken_file_is_named(run, tmp_path):
    write_spheres(tmp_path / "spheres", material.FIRST, 0)
    (tmp_path / "spheres" / material.FIRST / "spheres_00000001.npz").write_text("junk")
    assert "spheres_00000001.npz cannot be read" in run()


def test_training_that_goes_wrong(run, monkeypatch):
    def fail(folder):
        raise TrainingError("the gradients are not finite")

    monkeypatch.setattr(material, "load_spheres", fail)
    assert run() == "the gradients are not finite\n"


def test_all_mappers_and_then_others_for_the_same_autoencoder(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(material, "HELD_OUT", 2)
    monkeypatch.setattr("tools.train.spheres.HELD_OUT", 2)
    for mapper in MAPPERS:
        write_spheres(tmp_path / "spheres", mapper, 6)
    common = ["material", str(tmp_path / "spheres"), *(f"--{name}-steps=2" for name in ("mapper", "encoder", "other"))]
    monkeypatch.setattr(sys, "argv", [*common, "--work", str(tmp_path / "work"), "-o", str(tmp_path / "out")])
    assert material.main() == 0
    load_component(MaterialAutoencoder, tmp_path / "out" / "material_autoencoder")
    said = capsys.readouterr().out
    for name, kind in MAPPERS.items():
        load_component(kind, tmp_path / "out" / name)
        assert f'{name} {{"autoencoder_l1"' in said
    monkeypatch.setattr(sys, "argv", [*common, "--work", str(tmp_path / "other"), "-o", str(tmp_path / "others"),
                                      "--autoencoder", str(tmp_path / "out")])
    assert material.main() == 0
    assert sorted(path.name for path in (tmp_path / "others").iterdir()) == sorted(set(MAPPERS) - {material.FIRST})
