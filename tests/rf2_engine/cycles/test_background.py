# SPDX-License-Identifier: GPL-3.0-or-later
"""Where Cycles cannot be run inside Blender, one in the background renders a copy of the scene."""
import subprocess
import sys
import tempfile
import types

import bpy
import numpy as np
import OpenEXR
import pytest

import cycles.engine
from bl_ext.user_default.renderformer_v2.model import progress
from bl_ext.user_default.renderformer_v2.model.errors import RenderCancelled
from bl_ext.user_default.renderformer_v2.rf2_engine.cycles import background as background_cycles
from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render
from bl_ext.user_default.renderformer_v2.rf2_engine.progress.status import Status

from tests.rf2_engine.f12 import press_f12

REFERENCE = "ViewLayer.Cycles Reference"


@pytest.fixture
def without_cycles(monkeypatch, tmp_path):
    """Cycles' functions have other parameters than we know; temporary files go to a folder that is returned."""
    def changed(engine, data, *, parameters_of_the_next_version):
        pass

    folder = tmp_path / "temporary"
    folder.mkdir()

    def take_away():
        monkeypatch.setattr(cycles.engine, "create", changed)
        monkeypatch.setattr(tempfile, "tempdir", str(folder))
        return folder
    return take_away


@pytest.fixture
def started(monkeypatch):
    """The background Blenders that are started."""
    found = []

    class Process(subprocess.Popen):
        def __init__(self, arguments, **options):
            found.extend([self] * (str(background_cycles.WORKER) in arguments))
            super().__init__(arguments, **options)
    monkeypatch.setattr(subprocess, "Popen", Process)
    return found


def test_both_runs_are_those_of_cycles_inside(lit, tmp_path, without_cycles, started):
    """With a border, a light pass and Cryptomatte; the scene is animated, and was changed since it was loaded."""
    settings, layer = lit.render, lit.view_layers[0]
    settings.use_border, settings.border_min_x, settings.border_max_x, settings.border_max_y = True, 0.21, 0.83, 0.61
    layer.use_pass_cryptomatte_object = layer.use_pass_diffuse_direct = layer.use_pass_mist = True
    lit.objects["Cube"].keyframe_insert("location", frame=1)
    lit.objects["Cube"].location.x = 0.4
    lit.objects["Cube"].keyframe_insert("location", frame=3)
    lit.frame_set(2)
    lit.cycles.seed = 5
    inside = press_f12(lit, tmp_path)
    folder = without_cycles()
    outside = press_f12(lit, tmp_path)
    assert set(outside) == set(inside)
    for name in inside:
        np.testing.assert_allclose(outside[name], inside[name], rtol=1e-4, atol=1e-5, err_msg=name)
    assert outside[REFERENCE].max() > 0.1
    with OpenEXR.File(str(tmp_path / "picture.exr")) as file:
        assert any(key.endswith("/manifest") and "Cube" in str(value) for key, value in dict(file.header()).items())
    assert len(started) == 2 and all(process.returncode == 0 for process in started)
    assert not list(folder.iterdir())
    report = last_render.last_frame[0].report
    (line,) = [line for line in report if "Blender in the background" in line]
    assert "parameters_of_the_next_version" in line
    assert last_render.last_frame[0].reference_samples == 4 and lit.render.engine == "RENDERFORMER_V2"


@pytest.mark.slow
def test_a_lens_is_looked_through_as_inside(lit, tmp_path, without_cycles, started):
    """From several points of it, by a camera that something aims."""
    camera = lit.camera
    camera.constraints.new("TRACK_TO").target = lit.objects["Cube"]
    camera.data.dof.use_dof, camera.data.dof.focus_distance, camera.data.dof.aperture_fstop = True, 3.0, 0.3
    lit.renderformer_v2.lens_samples = 2
    inside = press_f12(lit, tmp_path)
    without_cycles()
    outside = press_f12(lit, tmp_path)
    for name in inside:
        np.testing.assert_allclose(outside[name], inside[name], rtol=1e-3, atol=1e-3, err_msg=name)
    assert len(started) == 4 and all(process.returncode == 0 for process in started)  # the reference is the last


def test_esc_ends_the_background_blender(lit, tmp_path, monkeypatch, without_cycles, started):
    folder = without_cycles()
    monkeypatch.setattr(Status, "esc_pressed", lambda status: status._displayed[0].startswith("Starting a background"))
    press_f12(lit, tmp_path)
    assert last_render.last_frame[0].cancelled
    assert len(started) == 1 and started[0].returncode != 0 and not list(folder.iterdir())


@pytest.mark.parametrize("broken, words", [("program", "install Blender"), ("worker", "ImportError: no such thing")])
def test_what_to_do_is_said_when_there_is_no_background_blender_either(lit, tmp_path, monkeypatch, without_cycles,
                                                                       broken, words):
    without_cycles()
    if broken == "program":
        monkeypatch.setattr(sys, "executable", str(tmp_path / "no such program"))
    else:
        worker = tmp_path / "worker.py"
        worker.write_text("raise ImportError('no such thing')")
        monkeypatch.setattr(background_cycles, "WORKER", worker)
    with pytest.raises(RuntimeError, match=words):
        bpy.ops.render.render(scene=lit.name)
    assert "parameters_of_the_next_version" in last_render.last_frame[0].error


def test_a_blender_that_keeps_its_samples_for_too_long_is_said(monkeypatch):
    def stop(text, fraction):
        raise RenderCancelled
    monkeypatch.setattr(background_cycles, "GRACE", 0.2)
    process = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"], stdin=subprocess.PIPE,
                               stdout=subprocess.PIPE, encoding="utf-8")
    engine = types.SimpleNamespace(update_stats=lambda *_: None)
    with progress.reporting(stop), pytest.raises(RenderCancelled, match="did not hand over its samples"):
        background_cycles._wait(engine, process, partial=True)
    assert process.poll() is not None


def test_the_last_sample_is_found_whatever_else_was_printed():
    printed = ["Fra:1 | Sample 7/64\n", *["Info: Saved\n"] * 40]
    assert background_cycles._status(printed) == "Background Blender Sample 7/64"
