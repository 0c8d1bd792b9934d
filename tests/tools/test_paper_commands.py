# SPDX-License-Identifier: GPL-3.0-or-later
"""The paper's tables from their commands to their files, on tiny scenes."""
import json
import sys

import numpy as np
import pytest
from skimage.io import imread

from tests.model.published import frames
from tools.common.pictures import read_pass
from tools.common.tone_mapping import tone_mapped
from tools.h5.pictures import save_picture
from tools.paper import __main__ as paper


def run(monkeypatch, capsys, *arguments) -> list[list[str]]:
    """The cells of the table that `tools.paper` prints, without its line of dashes and what Blender prints."""
    monkeypatch.setattr(sys, "argv", ["paper", *map(str, arguments)])
    assert paper.main() == 0
    head, _, *rows = (line for line in capsys.readouterr().out.splitlines() if line.startswith("|"))
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in (head, *rows)]


@pytest.mark.slow
def test_runtime_measures_what_is_missing_and_draws_it(tmp_path, monkeypatch, capsys):
    command = ["runtime", "-o", tmp_path, "--triangles", 300, "--fixed-triangles", 300, "--resolutions", 64,
               "--presets", "rf2_small", "--cycles-samples", 0, "--threads", 1]
    first = run(monkeypatch, capsys, *command)
    head, row = first
    assert head[0] == "triangles, pixels" and len(head) == 2 and row[0] == "300, 64"
    measured, = json.loads((tmp_path / "runtime.json").read_text())["measured"]
    assert row[1] == f"{measured['seconds']:.2f} s" and measured["seconds"] > 0
    assert imread(tmp_path / "runtime.png").std() > 10
    table = (tmp_path / "benchmark.csv").read_text()
    assert run(monkeypatch, capsys, *command) == first and (tmp_path / "benchmark.csv").read_text() == table


@pytest.mark.slow
def test_errors_by_triangles_have_full_attention_and_the_papers_numbers_beside_them(tmp_path, monkeypatch, capsys):
    head, row = run(monkeypatch, capsys, "lpips-triangles", "-o", tmp_path, "--triangles", 4096, "--resolution", 64,
                    "--samples", 2)
    assert [cell for cell in head if "PSNR" in cell] == [
        "ours: PSNR", "full attention: PSNR", "paper, RF-V2: PSNR", "paper, RF-V1: PSNR"]
    scores = json.loads((tmp_path / "lpips-triangles.json").read_text())["4096"]
    ours, full = scores["ours"], scores["full attention"]
    assert row[:2] == ["4096", f"{ours['psnr']:.2f}"] and row[5] == f"{full['psnr']:.2f}"
    assert row[9:] == ["33.84", "0.9776", "0.0198", "0.1025", "34.51", "0.9823", "0.0244", "0.0838"]
    assert ours["psnr"] != full["psnr"] and 15 < ours["psnr"] < 60 and 3000 < ours["triangles"] <= 4096


@pytest.mark.slow
def test_a_prepared_frame_is_drawn_by_us_and_by_cycles_and_shown_by_a_tone_mapper(tmp_path, monkeypatch, capsys):
    folder = frames.write(tmp_path / "cube-pile" / "frame", environment=True)
    (folder / "external").mkdir()
    save_picture(folder / "external" / "sky.exr", np.linspace(0.5, 3, 32 * 64 * 3).reshape(32, 64, 3))
    head, row = run(monkeypatch, capsys, "scenes", folder, "-o", tmp_path / "out",
                    "--resolution", 64, "--samples", 2, "--tone-mapper", "agx")
    assert row[0] == "cube-pile" and row[-5:] == ["3993", "26.41", "0.9243", "0.0474", "0.1031"]
    scores = json.loads((tmp_path / "out" / "scenes.json").read_text())["cube-pile"]
    assert row[head.index("psnr")] == f"{scores['psnr']:.2f}" and scores["psnr"] > 5
    assert scores["tone_mapper"] == "agx" and scores["triangles"] >= 14
    for engine in ("ours", "cycles"):
        path = tmp_path / "out" / f"cube-pile_{engine}.exr"
        shown = imread(path.with_suffix(".png"))
        assert shown.shape == (64, 64, 3) and shown.std() > 5
        assert (shown == tone_mapped(read_pass(path, "Combined", "RGB"), "agx")).all()


@pytest.mark.parametrize("arguments, status, message", [
    (["nothing"], 2, "python -m tools.paper runtime"), (["scenes", "nowhere", "-o", "OUT"], 1, "holds no scene")])
def test_what_cannot_be_made_is_said(tmp_path, monkeypatch, capsys, arguments, status, message):
    monkeypatch.setattr(sys, "argv", ["paper", *(str(tmp_path) if word == "OUT" else word for word in arguments)])
    assert paper.main() == status and message in capsys.readouterr().err
