# SPDX-License-Identifier: GPL-3.0-or-later
"""The job of training data in examples/farm: two sessions make what one would, and their folders are one."""
import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tools.datagen import manifest
from tools.datagen.sample_files import load_sample
from tools.extension import ROOT

TEMPLATE = ROOT / "examples" / "farm" / "data.openjd.yaml"


pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the job needs bash")


def start(out: Path, chunks: list[str]) -> subprocess.Popen:
    values = {"Repository": ROOT, "Python": sys.executable, "Output": out, "Seeds": "3-5", "SeedsPerTask": 2,
              "Profile": "simple", "Options": "--samples 1 --views 1 --resolution 32 --processes 1 --threads 1"}
    command = [sys.executable, "-m", "openjd", "run", str(TEMPLATE), "--step", "Generate",
               "--tasks", json.dumps([{"Seeds": chunk} for chunk in chunks])]
    command += [word for key, value in values.items() for word in ("-p", f"{key}={value}")]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def test_chunks_of_seeds_made_apart_are_a_whole(tmp_path):
    sessions = [start(tmp_path / "a", ["3-4"]), start(tmp_path / "b", ["5-5"])]
    for session in sessions:
        output, _ = session.communicate(timeout=900)
        assert session.returncode == 0, output
    shutil.copytree(tmp_path / "b", tmp_path / "a", dirs_exist_ok=True)
    problems, lines = manifest.check(tmp_path / "a")
    assert not problems and sorted(lines) == [f"scene_0000000{seed}.npz" for seed in (3, 4, 5)]
    assert not (tmp_path / "a" / manifest.ADDED).exists()
    scene, views, _, _ = load_sample(tmp_path / "a" / "scene_00000005.npz")
    assert len(views) == 1 and np.isfinite(scene.triangles).all()
