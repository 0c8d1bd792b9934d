# SPDX-License-Identifier: GPL-3.0-or-later
"""`tools.ablation` trains each row, measures it, and goes on where it was."""
import json

import pytest

from tests.tools.test_train_network import write
from tools import ablation


@pytest.mark.slow
def test_two_rows_are_trained_measured_and_not_trained_again(tmp_path, capsys):
    write(tmp_path / "data", 1)
    write(tmp_path / "held out", 2)
    out, config = tmp_path / "out", tmp_path / "config.json"
    config.write_text(json.dumps(json.loads(ablation.CONFIG.read_text()) | {"scenes_per_step": 1}))

    def run(steps: int, *rows: str) -> list[str]:
        folders = ["--data", tmp_path / "data", "--held-out", tmp_path / "held out", "--out", out, "--config", config]
        assert ablation.main([*map(str, folders), "--rows", *rows, "--steps", str(steps)]) == 0
        return capsys.readouterr().out.splitlines()

    def steps_logged(row: str) -> list[int]:
        return [json.loads(line)["step"] for line in (out / row / "log.jsonl").read_text().splitlines()]

    first = run(1, "full", "w/o SW")
    numbers = json.loads((out / "ablation.json").read_text())
    for line, name, paper in zip(first[2:], ("full", "w/o SW"), ("| 28.25 | 0.8982", "| 26.92 | 0.8715"), strict=True):
        assert line.startswith(f"| {name} | {numbers[name]['psnr']:.2f} | {numbers[name]['ssim']:.4f} |")
        assert paper in line
    assert numbers["full"]["psnr"] != numbers["w/o SW"]["psnr"]
    described = json.loads((out / "w_o_SW" / "weights" / "config.json").read_text())["model_config"]
    assert described["local_attention_window_size_half"] == 0

    assert run(1, "full", "w/o SW") == first and steps_logged("full") == steps_logged("w_o_SW") == [1]
    assert run(2, "full")[:2] == first[:2] and steps_logged("full") == [1, 2]
    assert json.loads((out / "full" / "weights" / "scores.json").read_text())["made_of"]["steps"] == 2
