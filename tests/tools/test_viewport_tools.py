# SPDX-License-Identifier: GPL-3.0-or-later
"""The command lines that draw viewports without a window."""
import csv
import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest

ROOT = Path(__file__).parents[2]


def called(*command: str) -> str:
    return subprocess.run([sys.executable, "-m", *command], check=True, capture_output=True, text=True, cwd=ROOT).stdout


@pytest.fixture
def cube(tmp_path):
    """The file that Blender starts with."""
    bpy.ops.wm.read_factory_settings()
    path = tmp_path / "cube.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


@pytest.mark.slow
def test_an_orbit_swings_there_and_back(cube, tmp_path):
    said = called("tools.orbit", str(cube), str(tmp_path / "frames"), "--frames", "4", "--size", "48x32",
                  "--budget", "256")
    assert "frame 4 of 4" in said
    frames = []
    for number in range(4):
        image = bpy.data.images.load(str(tmp_path / "frames" / f"{number:04}.png"))
        assert tuple(image.size) == (48, 32)
        frames.append(np.array(image.pixels[:]))
    assert np.ptp(frames[0]) > 0.3
    np.testing.assert_allclose(frames[0], frames[2], atol=2 / 255)
    assert min(np.abs(frames[i] - frames[j]).mean() for i, j in ((0, 1), (0, 3), (1, 3))) > 0.005


@pytest.mark.slow
def test_the_benchmark_has_a_row_for_each_kind_of_change(cube):
    said = called("tools.benchmark.viewport", str(cube), "--size", "64x48", "--budgets", "256", "--rounds", "1")
    rows = list(csv.DictReader(said.splitlines()))
    assert [row["change"] for row in rows] == ["enter", "move", "camera"]
    assert all(0 < float(row["8"]) <= float(row["4"]) <= float(row["1"]) for row in rows)
