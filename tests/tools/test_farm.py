# SPDX-License-Identifier: GPL-3.0-or-later
"""The job of examples/farm and the command lines of render managers: chunks side by side, and what failed ones leave.
"""
import argparse
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from matplotlib.pyplot import imread

from tools.extension import ROOT

TEMPLATE = ROOT / "examples" / "farm" / "frames.openjd.yaml"
MAKE_FILES = """
import os, sys
sys.path.insert(0, sys.argv[1])
import bpy
from tools import extension
extension.load().register()
scene = bpy.context.scene
ours = scene.renderformer_v2
scene.render.engine = "RENDERFORMER_V2"
scene.render.resolution_x, scene.render.resolution_y, ours.guide_samples = 48, 32, 1
cube = bpy.data.objects["Cube"]
cube.keyframe_insert("rotation_euler", frame=1)
cube.rotation_euler.z = 1.5
cube.keyframe_insert("rotation_euler", frame=4)
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[2] + "/cube.blend")
ours.weights_folder = "//no such folder"
for frame, ours.weights_source in ((1, "BUNDLED"), (2, "FOLDER"), (3, "BUNDLED")):
    ours.keyframe_insert("weights_source", frame=frame)
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[2] + "/broken.blend")
os._exit(0)
"""


needs_bash = pytest.mark.skipif(sys.platform == "win32", reason="the job needs bash")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Files of a turning cube, the second frame of one of them without weights; in a folder as users name it."""
    folder = tmp_path_factory.mktemp("Fränk's farm")
    subprocess.run([sys.executable, "-c", MAKE_FILES, str(ROOT), str(folder)], check=True, timeout=600)
    return folder


def blender(*arguments, **variables) -> subprocess.Popen:
    """Starts the command line, as a container has it, with further environment variables."""
    return subprocess.Popen([sys.executable, "-m", "tools.blender_command", *map(str, arguments)], cwd=ROOT,
                            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, encoding="utf-8",
                            env=os.environ | {"OMP_WAIT_POLICY": "PASSIVE"} | variables, start_new_session=True)


def ended(process: subprocess.Popen) -> tuple[int, str]:
    output, _ = process.communicate(timeout=900)
    return process.returncode, output


def session(folder: Path, name: str, chunks: list[str], weights: str = "rf2_small") -> subprocess.Popen:
    """Starts a session for some of the four frames; they go to the folder of that name."""
    program = folder / "blender"
    program.write_text(f'#!/bin/sh\nPYTHONPATH="{ROOT}" exec "{sys.executable}" -m tools.blender_command "$@"\n')
    program.chmod(0o755)
    values = {"BlendFile": folder / "cube.blend", "Output": folder / name / "####", "Frames": "1-4", "FramesPerTask": 2,
              "Blender": program, "Threads": 1, "Weights": weights}
    command = [sys.executable, "-m", "openjd", "run", str(TEMPLATE), "--step", "Render",
               "--tasks", json.dumps([{"Frames": chunk} for chunk in chunks])]
    command += [word for key, value in values.items() for word in ("-p", f"{key}={value}")]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, encoding="utf-8",
                            env=os.environ | {"OMP_WAIT_POLICY": "PASSIVE"})


def pictures(folder: Path) -> dict[str, bytes]:
    """{name: pixels} of all files there."""
    return {path.name: imread(path).tobytes() for path in sorted(folder.glob("*"))}


@pytest.fixture(scope="module")
def whole(folder):
    """The pictures of the animation by one process."""
    code, output = ended(blender("-b", folder / "cube.blend", "-t", 1, "-o", folder / "whole" / "####",
                                 "-s", 1, "-e", 4, "-a"))
    assert code == 0, output
    found = pictures(folder / "whole")
    assert list(found) == ["0001.png", "0002.png", "0003.png", "0004.png"] and len(set(found.values())) == 4
    return found


@pytest.mark.slow
@needs_bash
def test_two_sessions_side_by_side_make_the_pictures_of_one_process(folder, whole):
    sessions = [session(folder, "two", ["3-4"]), session(folder, "two", ["1-2"])]
    for code, output in map(ended, sessions):
        assert code == 0, output
        lines = [line[line.index("{"):] for line in output.splitlines() if '"state":' in line]
        assert [json.loads(line)["state"] for line in lines] == ["done", "done"]
        assert json.loads(lines[0])["threads"] == 1
    assert pictures(folder / "two") == whole


@needs_bash
def test_a_worker_without_the_weights_renders_nothing_and_fails(folder):
    code, output = ended(session(folder, "none", ["1-2"], weights="/there/is/no/such/folder"))
    assert code != 0 and "There is no weights folder /there/is/no/such/folder" in output
    assert not (folder / "none").exists()


@pytest.mark.slow
def test_the_command_line_that_flamenco_runs_makes_the_same_pictures(folder, whole):
    code, output = ended(blender("-b", "-y", "-t", 1, folder / "cube.blend", "--render-output",
                                 folder / "flamenco" / "######", "--render-format", "PNG", "--render-frame", "1,3..4"))
    assert code == 0, output
    assert pictures(folder / "flamenco") == {f"00{name}": whole[name] for name in ("0001.png", "0003.png", "0004.png")}
    assert output.count("Saved: '") == 3


def test_a_frame_that_failed_ends_its_chunk_with_1_and_leaves_no_file(folder):
    lines = folder / "lines of failures.jsonl"
    code, output = ended(blender("-b", folder / "broken.blend", "-o", folder / "failed" / "####", "-f", "2..4",
                                 RENDERFORMER_V2_FRAMES=str(lines)))
    assert code == 1 and "no such folder" in output and not (folder / "failed").exists()
    (line,) = map(json.loads, lines.read_text(encoding="utf-8").splitlines())
    assert (line["frame"], line["state"]) == (2, "failed") and "no such folder" in line["errors"][0]
    assert line["blend"] == str(folder / "broken.blend")


@pytest.mark.parametrize("how, status", [("SIGKILL", -9), ("SIGINT", 130)])
@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_a_chunk_that_is_ended_leaves_nothing_behind(folder, how, status):
    """No half picture, no process and no temporary folder; the frames that were done stay. SIGINT is Ctrl-C."""
    temporary, out = folder / f"temporary {how}", folder / how
    temporary.mkdir()
    running = blender("-b", folder / "cube.blend", "-t", 1, "-o", out / "####", "-s", 1, "-e", 100, "-a",
                      TMPDIR=str(temporary))
    assert any("Saved: '" in line for line in running.stdout)
    time.sleep(0.1)  # within the next frame
    running.send_signal(getattr(signal, how))
    assert ended(running)[0] == status
    with pytest.raises(ProcessLookupError):
        os.killpg(running.pid, 0)
    names = sorted(path.name for path in out.iterdir())
    assert names == [f"{i:04d}.png" for i in range(1, len(names) + 1)] and len(names) < 100
    shown = [imread(path) for path in out.glob("*.png")]
    assert {picture.shape for picture in shown} == {(32, 48, 4)} and all(picture[..., 3].all() for picture in shown)
    left = list(temporary.rglob("*"))
    assert not (left if how == "SIGINT" else [path for path in left if path.is_file()])  # empty folders are left


def test_wrong_arguments_end_with_2_before_blender_starts():
    code, output = ended(blender("-b", "file.blend"))
    assert code == 2 and "an animation (-a) or frames (-f) are needed" in output


@pytest.mark.parametrize("arguments", [["--command", "extension", "list"], ["--command"], ["a.blend", "-f", "1..x"],
                                       ["a.blend", "-f", "1..2..3"], ["a.blend", "-a", "-f", "1"], []])
def test_other_wrong_arguments_are_explained(monkeypatch, capsys, arguments):
    from tools import blender_command
    monkeypatch.setattr(sys, "argv", ["blender", *arguments])
    with pytest.raises(SystemExit, match="2"):
        blender_command.main()
    assert "blender: error: " in capsys.readouterr().err


def test_formats_are_those_of_blender():
    import bpy

    from tools import blender_command
    render = bpy.context.scene.render
    for known in ("OPEN_EXR_MULTILAYER", "PNG"):
        blender_command.prepare(render, argparse.Namespace(threads=0, output=None, format=known))
        assert render.image_settings.file_format == known
    with pytest.raises(ValueError, match="-F PICTURE: .*PNG"):
        blender_command.prepare(render, argparse.Namespace(threads=0, output=None, format="PICTURE"))
