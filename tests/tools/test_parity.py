# SPDX-License-Identifier: GPL-3.0-or-later
"""`python -m tools.parity` compares what it can and passes over nothing in silence."""
import json
import sys

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from tools.parity import __main__ as parity
from tools.parity.cases import Case
from tools.parity.results import texture_results


def run(monkeypatch, *arguments) -> int:
    monkeypatch.setattr(sys, "argv", ["parity", *map(str, arguments)])
    return parity.main()


@pytest.fixture
def folder(tmp_path):
    """Two cases that recorded what is computed now."""
    random = np.random.default_rng(1)
    inputs = {"in.latent_u8": random.integers(0, 256, (8, 8, 9), np.uint8), "in.emissive": np.float32([1, 2, 3]),
              "in.normal_u8": random.integers(0, 256, (8, 8, 3), np.uint8),
              "in.height_u8": random.integers(0, 256, (8, 8), np.uint8), "in.uv": random.random((2, 3, 2), np.float32)}
    case = Case("a", {"kind": "texture"}, {key: torch.from_numpy(array) for key, array in inputs.items()})
    for name in ("a", "b"):
        (tmp_path / f"{name}.json").write_text(json.dumps(case.info))
        save_file(case.tensors | texture_results(case), tmp_path / f"{name}.safetensors")
    return tmp_path


def test_a_right_folder_passes(folder, monkeypatch, capsys):
    assert run(monkeypatch, folder) == 0
    assert capsys.readouterr().out.endswith("4 tensors, largest error 0.000e+00\n")


@pytest.mark.parametrize("lost, said", [("a.safetensors", "a FileNotFoundError"), ("a.json", "a FileNotFoundError"),
                                        (None, "a KeyError: 'odd'")])
def test_a_case_that_cannot_be_run_has_failed_and_the_others_follow(folder, monkeypatch, capsys, lost, said):
    if lost:
        (folder / lost).unlink()
    else:
        (folder / "a.json").write_text(json.dumps({"kind": "odd"}))
    assert run(monkeypatch, folder) == 1
    first, *others = capsys.readouterr().out.splitlines()
    assert first.startswith(said) and first.endswith("inf  FAILED")
    assert [line.split()[0] for line in others] == ["b", "b", "3"]


def test_checks_need_no_tensors(folder, monkeypatch, capsys):
    (folder / "selfcheck.json").write_text(json.dumps({"02b_width": 117, "99_unknown": 0}))
    assert run(monkeypatch, folder) == 1
    out = capsys.readouterr().out
    assert "selfcheck 02b_width 0.000e+00\n" in out and "selfcheck 99_unknown inf  FAILED" in out


def test_a_case_that_cannot_be_run_has_no_precision(folder, monkeypatch, capsys):
    (folder / "net_full_few.json").write_text("{")
    assert run(monkeypatch, folder, "--precision", "bf16") == 1
    assert capsys.readouterr().out.startswith("net_full_few JSONDecodeError: ")


@pytest.mark.parametrize("arguments", [[], ["--precision", "bf16"]])
def test_a_folder_without_fixtures_has_not_passed(tmp_path, monkeypatch, capsys, arguments):
    assert run(monkeypatch, tmp_path / "nowhere", *arguments) == 1
    assert "no fixtures" in capsys.readouterr().err
