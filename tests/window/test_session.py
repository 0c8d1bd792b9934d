# SPDX-License-Identifier: GPL-3.0-or-later
"""A session in Blender's window, with keys, mouse and screenshots.

    RENDERFORMER_V2_BLENDER=/path/to/blender make window

needs a display, xdotool, ImageMagick, and PyTorch in that Blender. The screenshots stay in examples/out/window.
"""
import json
import os
import subprocess
from pathlib import Path

import pytest

from tools.build import build

BLENDER = os.environ.get("RENDERFORMER_V2_BLENDER", "")
PATIENCE = 1800  # seconds, on a machine that does other things too

pytestmark = [pytest.mark.slow,
              pytest.mark.skipif(not BLENDER, reason="RENDERFORMER_V2_BLENDER names no Blender with a window")]


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    return recorded(tmp_path_factory.mktemp("window"), "session.py")


def recorded(folder, script, *parts, size=(1600, 900)):
    """What a session wrote down, or parts of it, in a window of this size; `script` lies beside this file."""
    environment = os.environ | {f"BLENDER_USER_{kind}": str(folder / kind.lower()) for kind in (
        "RESOURCES", "CONFIG", "SCRIPTS", "EXTENSIONS", "DATAFILES")}
    archive, shots = build(folder), folder / "shots"
    shots.mkdir()
    subprocess.run([BLENDER, "--factory-startup", "--window-geometry", "0", "0", *map(str, size), "--python",
                    str(Path(__file__).with_name(script)), "--", str(archive), str(shots), *parts],
                   env=environment, timeout=PATIENCE, check=True)
    done = json.loads((shots / "session.json").read_text())
    assert "error" not in done, done["error"]
    return done


def test_a_line_says_how_far_cycles_is(found):
    assert any(line.startswith("Camera rays and direct light ") for line in found["lines"])
    assert any(line.startswith("RenderFormer 100 %, Cycles ") for line in found["lines"])
    assert found["reference_samples"] == 64


def test_the_picture_and_its_reference_are_seen_together_without_choosing_anything(found):
    show, mode, ours, reference = found["both"]
    assert show and mode == "SPLIT" and ours.startswith("RenderFormer-V2, ")
    assert reference.startswith("Cycles, 64 samples, ")
    assert found["button"] == [False, True]


@pytest.mark.parametrize("name", ["reference", "region"])
def test_the_reference_is_seen_while_it_grows_and_esc_keeps_its_samples(found, name):
    (first, second), kept, report, label, forgotten = found[f"{name}_stopped"]
    assert 0 < first < second <= kept < 1 << 20
    assert any(f"stopped after {kept} of" in line for line in report) and label.startswith(f"Cycles, {kept} samples, ")
    assert found[f"{name}_grown_off"] < 0.2 and forgotten
    assert found[f"{name}_buttons"] == [True, False, True]


def test_last_render_survives_a_render_of_cycles_in_another_slot(found):
    kept, ours, cycles = found["slots"]
    assert kept and ours.startswith("RenderFormer-V2, ") and cycles.startswith("Cycles, 16 samples, ")


def test_preflight_knows_that_it_is_outdated(found):
    lines, outdated = found["preflight"]
    assert "triangles for the network" in lines[0] and outdated


def test_preflight_refuses_what_a_render_refuses(found):
    lines, error = found["refused"]
    assert error and error in " ".join(lines)


def test_what_is_said_of_many_things_is_one_line(found):
    assert any("7 (Lamp, Lamp.001, Lamp.002 and 4 more)" in line for line in found["report"])


def test_the_split_follows_the_mouse(found):
    assert found["split"] > 0.55


def test_compare_shows_what_blender_shows_and_leaves_files_alone(found):
    assert found["contrast"] > 0.2 and max(found["off"]) < 2 / 255 and found["saved_alike"]


def test_the_comparison_is_exported(found):
    assert found["exported"] == [True, True] and found["closeness"] > 15


def test_esc_ends_each_stage_and_keeps_our_picture_during_the_reference(found):
    *before, reference = found["escaped"].values()
    assert before == ["cancelled"] * 3
    assert any("stopped" in line for line in reference)


def test_a_saved_file_is_compared_like_the_render(found):
    assert found["file_is_the_render"]


def test_what_goes_away_while_it_is_compared_is_said(found):
    said = found["said"]
    assert "no image 'gone'" in said["image_is_gone"] and "pixels, B 200 x" in said["other_size"]
    assert "Slot 3 is empty" in said["slot_removed"]  # it has its name still


def test_a_render_ends_as_it_began_when_the_engine_is_changed(found):
    assert found["engine_changed"] == ["", 64]


def test_a_blender_in_the_background_renders_where_cycles_cannot_be_run_inside(found):
    elsewhere = found["elsewhere"]
    assert elsewhere["samples"] == 64 and any("in the background" in line for line in elsewhere["report"])
    assert any(line.startswith("RenderFormer 100 %, Cycles ") for line in elsewhere["lines"])


def test_esc_keeps_what_a_blender_in_the_background_has_rendered(found):
    samples, report = found["elsewhere_stopped"]
    assert 0 < samples < 1 << 20 and any(f"stopped after {samples} of" in line for line in report)
