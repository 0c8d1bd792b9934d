# SPDX-License-Identifier: GPL-3.0-or-later
"""The job of examples/farm: chunks of frames in sessions side by side, and what a worker without weights leaves."""
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from matplotlib.pyplot import imread

from tools.extension import ROOT

TEMPLATE = ROOT / "examples" / "farm" / "frames.openjd.yaml"
MAKE_FILE = """
import os, sys
sys.path.insert(0, sys.argv[1])
import bpy
from tools import extension
extension.load().register()
scene = bpy.context.scene
scene.render.engine = "RENDERFORMER_V2"
scene.render.resolution_x, scene.render.resolution_y, scene.renderformer_v2.guide_samples = 48, 32, 1
cube = bpy.data.objects["Cube"]
cube.keyframe_insert("rotation_euler", frame=1)
cube.rotation_euler.z = 1.5
cube.keyframe_insert("rotation_euler", frame=4)
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[2])
os._exit(0)
"""


pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the job needs bash")


@pytest.fixture(scope="module")
def job(tmp_path_factory):
    """Starts a session for some of the four frames of a turning cube; they go to the folder of that name."""
    folder = tmp_path_factory.mktemp("farm")
    file, blender = folder / "cube.blend", folder / "blender"
    subprocess.run([sys.executable, "-c", MAKE_FILE, str(ROOT), str(file)], check=True, timeout=600)
    blender.write_text(f'#!/bin/sh\nPYTHONPATH="{ROOT}" exec "{sys.executable}" -m tools.blender_command "$@"\n')
    blender.chmod(0o755)

    def start(name: str, chunks: list[str], weights: str = "rf2_small") -> subprocess.Popen:
        values = {"BlendFile": file, "Output": folder / name / "####", "Frames": "1-4", "FramesPerTask": 2,
                  "Blender": blender, "Threads": 1, "Weights": weights}
        command = [sys.executable, "-m", "openjd", "run", str(TEMPLATE), "--step", "Render",
                   "--tasks", json.dumps([{"Frames": chunk} for chunk in chunks])]
        command += [word for key, value in values.items() for word in ("-p", f"{key}={value}")]
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                                env=os.environ | {"OMP_WAIT_POLICY": "PASSIVE"})
    return folder, start


def ended(session: subprocess.Popen) -> tuple[int, str]:
    output, _ = session.communicate(timeout=900)
    return session.returncode, output


def pictures(folder: Path) -> dict[str, bytes]:
    """{name: pixels} of all files there."""
    return {path.name: imread(path).tobytes() for path in sorted(folder.glob("*"))}


def test_two_sessions_side_by_side_make_the_pictures_of_one(job):
    folder, start = job
    sessions = [start("two", ["3-4"]), start("two", ["1-2"])]
    for code, output in map(ended, sessions):
        assert code == 0, output
        lines = [line[line.index("{"):] for line in output.splitlines() if '"state":' in line]
        assert [json.loads(line)["state"] for line in lines] == ["done", "done"]
        assert json.loads(lines[0])["threads"] == 1
    code, output = ended(start("one", ["1-2", "3-4"]))
    assert code == 0, output
    found = pictures(folder / "two")
    assert list(found) == ["0001.png", "0002.png", "0003.png", "0004.png"] and found == pictures(folder / "one")
    assert len(set(found.values())) == 4


def test_a_worker_without_the_weights_renders_nothing_and_fails(job):
    folder, start = job
    code, output = ended(start("none", ["1-2"], weights="/there/is/no/such/folder"))
    assert code != 0 and "There is no weights folder /there/is/no/such/folder" in output
    assert not (folder / "none").exists()


def test_the_command_line_that_flamenco_runs_makes_the_same_pictures(job):
    folder, start = job
    code, output = ended(start("whole", ["1-2", "3-4"]))
    assert code == 0, output
    done = subprocess.run([folder / "blender", "-b", "-y", folder / "cube.blend", "-t", "1", "--render-output",
                           folder / "flamenco" / "####", "--render-format", "PNG", "--render-frame", "1,3..4"],
                          capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stderr
    whole = pictures(folder / "whole")
    del whole["0002.png"]
    assert pictures(folder / "flamenco") == whole


def test_a_killed_chunk_leaves_nothing_behind(job):
    """No half picture, no process and no temporary folder; the frames that were done stay."""
    folder, _ = job
    temporary = folder / "temporary"
    temporary.mkdir()
    running = subprocess.Popen([folder / "blender", "-b", folder / "cube.blend", "-t", "1", "-o",
                                folder / "killed" / "####", "-s", "1", "-e", "100", "-a"],
                               stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                               env=os.environ | {"TMPDIR": str(temporary)}, start_new_session=True)
    begin = time.monotonic()
    while not (folder / "killed" / "0002.png").exists():
        assert running.poll() is None and time.monotonic() - begin < 600
        time.sleep(0.02)
    running.kill()
    running.wait()
    with pytest.raises(ProcessLookupError):
        os.killpg(running.pid, 0)
    names = sorted(path.name for path in (folder / "killed").iterdir())
    assert names == [f"{i:04d}.png" for i in range(1, len(names) + 1)]
    shapes = {imread(path).shape for path in (folder / "killed").glob("*.png")}
    assert shapes == {(32, 48, 4)} and not [path for path in temporary.rglob("*") if path.is_file()]
