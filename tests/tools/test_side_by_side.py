# SPDX-License-Identifier: GPL-3.0-or-later
"""The picture of a scene by this engine in two ways, by Cycles in the same time, and by Cycles with many samples."""
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from skimage.io import imread

from tools.benchmark import ring
from tools.side_by_side import GAP, side_by_side

ROOT = Path(__file__).parents[2]


def run(*arguments) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, "-m", "tools.side_by_side", *map(str, arguments)], cwd=ROOT, text=True,
                          capture_output=True, timeout=600)


@pytest.mark.parametrize("height, width", [(512, 512), (90, 161)])
def test_pictures_stay_as_they_are_and_each_has_a_label(height, width):
    pictures = list(np.random.default_rng(0).integers(0, 256, (3, height, width, 3), np.uint8))
    sheet = side_by_side(pictures, ["one", "two", ""])
    assert sheet.shape[0] > height and sheet.shape[1:] == (3 * width + 2 * GAP, 3)
    for i, picture in enumerate(pictures):
        left = i * (width + GAP)
        assert (sheet[:height, left:left + width] == picture).all()
        assert (sheet[height:, left:left + width].min() < 128) == (i < 2)
    assert (sheet[:height, width:width + GAP] == 255).all()


@pytest.mark.slow
def test_four_renders_are_measured_and_written_as_one_picture(tmp_path):
    import bpy
    ring.build(ring.LEAST, 32)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "room.blend"))
    done = run(tmp_path / "room.blend", "-o", tmp_path / "new" / "out.png", "--samples", 2, "--resolution", "40x32")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["transformer_alone"]["seconds"] > 0 and found["with_cycles"]["seconds"] > 0
    assert found["cycles_equal"]["samples"] <= 2
    assert found["cycles"]["samples"] == 2 and found["cycles"]["seconds"] > 0
    sheet = imread(tmp_path / "new" / "out.png")
    assert sheet.shape[0] > 32 and sheet.shape[1] == 4 * 40 + 3 * GAP
    assert all(sheet[:32, left:left + 40].std() > 5 for left in (0, 48, 96, 144))


def test_a_scene_that_is_not_there_is_named_and_nothing_is_written(tmp_path):
    done = run(tmp_path / "none.blend", "-o", tmp_path / "out.png")
    assert done.returncode == 1 and "none.blend: there is no such file" in done.stderr
    assert "Traceback" not in done.stderr and not list(tmp_path.iterdir())
