# SPDX-License-Identifier: GPL-3.0-or-later
"""`python -m tools.train.curves`: the logs of one run in one picture."""
import json
import sys

from skimage.io import imread

from tools.train import curves


def write(path, steps, loss):
    lines = [{"step": step, "image": loss, "direct": loss, "indirect": loss} for step in steps]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return path


def test_parts_of_a_run_follow_each_other_and_the_later_one_counts(tmp_path):
    first, second = write(tmp_path / "a", (50, 100, 150), 2.0), write(tmp_path / "b", (100, 200), 1.0)
    assert [(line["step"], line["image"]) for line in curves.points([first, second])] == [
        (50, 2.0), (100, 1.0), (200, 1.0)]


def test_the_picture_is_written_and_other_files_are_refused(tmp_path, monkeypatch, capsys):
    log, other = write(tmp_path / "log.jsonl", range(50, 1000, 50), 0.1), tmp_path / "other"
    other.write_text("{}\n")
    for file, status in ((log, 0), (other, 1)):
        monkeypatch.setattr(sys, "argv", ["curves", str(file), "-o", str(tmp_path / "out.png")])
        assert curves.main() == status
    assert imread(tmp_path / "out.png").shape[1] > 500
    assert "is no log of tools.train.network" in capsys.readouterr().err
