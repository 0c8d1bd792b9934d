# SPDX-License-Identifier: GPL-3.0-or-later
"""The evaluation measures what it says, on samples and on .blend files."""
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from renderformer_v2.model.renderer import Renderer
from tests.model.samples import floor_scene, floor_view
from tools.datagen.shards import save_sample
from tools.metrics import compare, psnr

ROOT = Path(__file__).parents[2]
SCENE = """
import os, sys, bpy
bpy.ops.wm.read_homefile(use_factory_startup=True)
render, scene = bpy.context.scene.render, bpy.context.scene
render.resolution_x, render.resolution_y, scene.cycles.samples = 48, 40, 4
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])
sys.stdout.flush(), os._exit(0)
"""


def evaluate(folder: Path, report: Path) -> dict:
    done = subprocess.run([sys.executable, "-m", "tools.evaluate", str(folder), "-o", str(report)], cwd=ROOT,
                          capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    printed = json.loads(done.stdout)
    assert printed == json.loads((report / "report.json").read_text())
    return printed


def test_metrics_of_known_differences():
    picture = np.random.default_rng(0).random((32, 32, 3)).astype(np.float32)
    assert compare(picture, picture) == pytest.approx({"psnr": 100.0, "ssim": 1.0, "flip": 0.0}, abs=1e-4)
    assert psnr(np.full((4, 4, 3), 0.5), np.full((4, 4, 3), 0.6)) == pytest.approx(20.0)


def test_a_sample_whose_reference_is_our_own_picture_is_perfect_and_a_darker_one_is_not(tmp_path):
    scene, (view, guides) = floor_scene(), floor_view()
    picture = Renderer().encode(scene).view(view, guides)
    for seed, factor in ((1, 1.0), (2, 0.25)):
        combined = np.concatenate([picture * factor, guides.alpha[..., None]], axis=-1)
        save_sample(tmp_path / f"scene_{seed:08d}.npz", scene, [view], [guides], [{"combined": combined}])
    scenes = evaluate(tmp_path, tmp_path / "report")["scenes"]
    same, darker = (scenes[f"scene_{seed:08d}"] for seed in (1, 2))
    assert same["psnr"] > 35 and darker["psnr"] < same["psnr"] - 5 and darker["flip"] > same["flip"]


def test_blend_files_are_rendered_by_both_engines(tmp_path):
    command = [sys.executable, "-c", SCENE, str(tmp_path / "cube.blend")]
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    report = evaluate(tmp_path, tmp_path / "report")
    assert report["scenes"]["cube"]["psnr"] > 15 and report["scenes"]["cube"]["cycles_seconds"] > 0
    assert (tmp_path / "report" / "cube.png").is_file()
