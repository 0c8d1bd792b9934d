# SPDX-License-Identifier: GPL-3.0-or-later
"""One line of JSON for each frame of a render that nobody watches."""
import json
import os

import bpy
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.progress import frame_lines
from bl_ext.user_default.renderformer_v2.rf2_engine.progress.status import Status

from tests.rf2_engine.f12 import cube


@pytest.fixture
def lines(scene, tmp_path, monkeypatch):
    """Renders frames 5 and 6 of a cube; the lines that this has written."""
    cube(scene)
    scene.frame_start, scene.frame_end = 5, 6
    scene.render.filepath = str(tmp_path / "picture_")
    file = tmp_path / "lines.jsonl"
    monkeypatch.setenv(frame_lines.VARIABLE, str(file))

    def run(**how) -> list[dict]:
        file.unlink(missing_ok=True)
        try:
            bpy.ops.render.render(scene=scene.name, **how)
        except RuntimeError:
            pass
        return [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    return run


def test_every_frame_of_an_animation_has_its_line(scene, lines):
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    found = lines(animation=True)
    assert [(line["frame"], line["state"], line["errors"]) for line in found] == [(5, "done", []), (6, "done", [])]
    for line in found:
        assert line["threads"] == 1 and line["process"] == os.getpid() and line["memory_mib"] > 100
        assert line["seconds"] > sum(line["layers"][0]["seconds"].values()) - 0.01
        assert line["layers"][0]["triangles"] == 24


def test_frames_that_are_there_already_have_none(scene, lines):
    lines(animation=True)
    scene.render.use_overwrite = False
    assert lines(animation=True) == []


def test_what_is_not_saved_has_a_line_too(scene, lines):
    scene.frame_set(6)
    (line,) = lines()
    assert line["frame"] == 6 and line["state"] == "done"


@pytest.mark.parametrize("how", ["animation", "write_still"])
def test_a_frame_that_failed_says_why(scene, lines, how):
    scene.renderformer_v2.weights_source = "FOLDER"
    scene.frame_set(5)
    (line,) = lines(**{how: True})
    assert (line["frame"], line["state"], line["layers"]) == (5, "failed", []) and "Weights" in line["errors"][0]


def test_a_render_that_blender_refuses_has_a_line(scene, lines):
    scene.camera = None
    (line,) = lines(animation=True)
    assert line["state"] == "failed" and line["frame"] == 5 and line["errors"] == [frame_lines.LOST]


def test_a_picture_that_cannot_be_saved_is_said(scene, lines, tmp_path):
    (tmp_path / "file").write_bytes(b"")
    scene.render.filepath = str(tmp_path / "file" / "picture_")
    (line,) = lines(animation=True)
    assert (line["frame"], line["state"], line["errors"]) == (5, "failed", [frame_lines.UNSAVED])


def test_a_cancelled_frame_is_neither(scene, lines, monkeypatch):
    monkeypatch.setattr(Status, "esc_pressed", lambda status: True)
    (line,) = lines()
    assert line["state"] == "cancelled" and line["errors"] == []


def test_other_engines_and_unset_variables_write_nothing(scene, lines, monkeypatch):
    scene.render.engine, scene.cycles.samples = "CYCLES", 1
    assert lines() == []
    scene.render.engine = "RENDERFORMER_V2"
    monkeypatch.delenv(frame_lines.VARIABLE)
    assert lines() == []


def test_a_file_that_cannot_be_written_ends_nothing(scene, lines, monkeypatch, capfd, tmp_path):
    monkeypatch.setenv(frame_lines.VARIABLE, str(tmp_path / "no folder" / "lines"))
    assert lines(write_still=True) == [] and list(tmp_path.glob("picture_*"))
    assert "cannot be written" in capfd.readouterr().err


def test_lines_go_to_the_output_as_well(scene, lines, monkeypatch, capsys):
    monkeypatch.setenv(frame_lines.VARIABLE, "-")
    lines()
    assert '"state": "done"' in capsys.readouterr().out
