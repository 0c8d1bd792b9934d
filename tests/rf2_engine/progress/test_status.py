# SPDX-License-Identifier: GPL-3.0-or-later
"""One progress bar for a whole F12, which never runs backwards, and words about it that a user knows."""
import mmap
import re
import time
from ctypes import addressof, create_string_buffer
from functools import partialmethod
from types import SimpleNamespace

import bpy
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.progress import cycles_text, estimate, memory
from bl_ext.user_default.renderformer_v2.rf2_engine.progress.stages import FIRST_HITS, REFERENCE
from bl_ext.user_default.renderformer_v2.rf2_engine.progress.status import Status
from bl_ext.user_default.renderformer_v2.rf2_engine.progress.status_line import status_line

from tests.rf2_engine.f12 import cube, press_f12


@pytest.fixture
def bar(monkeypatch):
    """[(view layer, text, bar)] of whatever is reported."""
    reported = []

    def report(status, text, fraction, real=Status.__call__):
        real(status, text, fraction)
        reported.append((status._layer, text, estimate.frame.bar))
    monkeypatch.setattr(Status, "__call__", report)
    return reported


def test_the_bar_never_runs_backwards_over_several_view_layers(scene, tmp_path, bar):
    cube(scene)
    scene.view_layers.new("Second")
    press_f12(scene, tmp_path)
    first = [value for layer, _, value in bar if layer == "ViewLayer"]
    second = [value for layer, _, value in bar if layer == "Second"]
    assert first == sorted(first) and second == sorted(second)
    assert first[0] < 0.3 and first[-1] <= second[0] < 0.95 and second[-1] > 0.95


def test_one_view_layer_is_not_named(scene, tmp_path, bar):
    cube(scene)
    press_f12(scene, tmp_path)
    assert {layer for layer, _, _ in bar} == {""}
    assert {"Reading objects, 1 of 2", "Adding the light up"} <= {text for _, text, _ in bar}


def test_every_frame_of_an_animation_begins_at_nothing(scene, tmp_path, bar):
    cube(scene)
    scene.frame_start, scene.frame_end, scene.render.filepath = 1, 2, str(tmp_path / "frame_")
    bpy.ops.render.render(animation=True, scene=scene.name)
    starts = [i for i, (_, text, _) in enumerate(bar)
              if text == "Converting the scene" and (i == 0 or bar[i - 1][2] > 0.99)]
    assert len(starts) == 2 and all(bar[i][2] < 0.5 for i in starts)


def test_a_stage_that_takes_longer_than_expected_stops_the_bar_short_of_its_end():
    frame = estimate.Frame()
    frame.begin_layer(1, {FIRST_HITS: 0.01})
    frame.begin_stage(FIRST_HITS)
    frame.stage_begin -= 10
    frame.begin -= 10
    assert 1 < frame.remaining(0.0) < 10 and frame.bar < 0.95


def test_a_stage_at_one_pace_is_judged_by_it_whatever_it_took_before():
    frame = estimate.Frame()
    frame.begin_layer(1, {REFERENCE: 1000.0})
    frame.begin_stage(REFERENCE)
    frame.stage_begin -= 5
    assert frame.remaining(0.25, is_steady=True) == pytest.approx(15, rel=0.1)
    frame.stage_begin -= 5
    assert frame.remaining(0.25, is_steady=True) == pytest.approx(10, rel=0.1)  # nothing was heard since
    assert frame.remaining(0.25) > 500


def test_memory_counts_what_python_packages_hold():
    before, _ = memory.measure()
    with mmap.mmap(-1, 200 << 20) as block:  # fresh, where allocators may have as much left over
        block.write(bytes(200 << 20))
        now, most = memory.measure()
    assert now - before > 150 and most >= now


def test_the_peak_is_that_of_this_render_with_all_its_view_layers(monkeypatch):
    shown, measured = [], iter([(800.0, 5004.0), (900.0, 5004.0), (850.0, 5004.0), (850.0, 5004.0), (860.0, 5004.0),
                                (870.0, 5100.0)])
    engine = SimpleNamespace(test_break=lambda: False, update_stats=lambda *_: None, update_progress=lambda _: None,
                             update_memory_stats=lambda memory_used, memory_peak: shown.append(memory_peak))
    monkeypatch.setattr(memory, "measure", lambda: next(measured))
    monkeypatch.setattr(estimate, "frame", estimate.Frame())
    first = Status(engine)
    first("Camera rays", 0.0)
    assert first.memory_added == 100 and shown == [900]  # 5004 were an earlier render's
    second = Status(engine, "Second")
    second("Camera rays", 0.0)
    second("Network", 0.5)
    assert shown == [900, 900, 5100]  # the process has never used more: that is now


@pytest.fixture
def lines(monkeypatch):
    """What is said while Cycles runs in a window, and the bar at each line."""
    said = []
    monkeypatch.setattr(Status, "during_cycles", partialmethod(Status.during_cycles, window=True))
    monkeypatch.setattr(status_line, "show", lambda text: said.append((text, estimate.frame.bar)))
    return said


def test_both_runs_of_cycles_say_how_far_they_are_and_how_long_the_frame_takes(lit, tmp_path, lines):
    lit.render.resolution_x = lit.render.resolution_y = 64
    lit.cycles.use_auto_tile, lit.cycles.tile_size = True, 16  # Cycles says more than once how far it is
    lit.renderformer_v2.reference.samples = 256
    press_f12(lit, tmp_path)
    first = re.compile(r"Camera rays and direct light( \d+ %)?, \d+:\d\d left")
    beside = re.compile(r"RenderFormer 100 %, Cycles(?: (\d+) %)?, \d+:\d\d left")
    shown = [text for text, _ in lines if text]
    assert first.fullmatch(shown[0]) and beside.fullmatch(shown[-1])
    percents = [int(found[1]) for text in shown if (found := beside.fullmatch(text)) and found[1]]
    assert percents == sorted(percents) and any(0 < percent < 100 for percent in percents)
    bars = [bar for text, bar in lines if beside.fullmatch(text)]
    assert bars == sorted(bars) and lines[-1][0] == ""


@pytest.mark.parametrize("text, expected", [
    ("Mem:0.09M, Peak:0.09M | Scene, ViewLayer | Sample 0/24", 0),
    ("Remaining:00:01.39 | Mem:6.61M, Peak:6.61M | Scene, ViewLayer | Sample 6/24", 0.25),
    ("Remaining: 00:00.98 | Mem: 4M | Sample 6/24", 0.25),
    ("Remaining:00:00.51 | Mem:1.35M | Scene, ViewLayer | Rendered 1/4 Tiles, Sample 12/24", 0.375),
    ("Remaining:00:00.51 | Mem:1.35M | Scene, ViewLayer | Rendered 2/4 Tiles, Sample 24/24", 0.5),
    ("Mem:0.00M, Peak:1.43M | Scene | ViewLayer | Denoising", 1),
    ("Mem: 1M | Updating Scene BVH | Building BVH", 0),
    ("", 0),
])
def test_the_status_of_cycles_says_how_far_it_is(text, expected):
    assert cycles_text.fraction(text) == pytest.approx(expected)
    assert cycles_text.fraction(text, elapsed=3, time_limit=4) == pytest.approx(max(expected, 0.75))


def test_cycles_cannot_move_the_bar_back(monkeypatch):
    """Its session sets it too, from 0 to 1; in a window somebody sets it right again."""
    class Engine:
        bar, struct = 0.7, create_string_buffer(1024)

        def update_progress(self, fraction):
            self.bar = fraction

        def update_stats(self, _, text):
            self.struct.raw = bytes(64) + text.encode()

        def update_memory_stats(self, memory_used=0.0, memory_peak=0.0):
            self.memory = memory_used

        def test_break(self):
            return False

        def as_pointer(self):
            return addressof(self.struct)

    status, frame = Status(Engine()), estimate.Frame(bar=0.7)
    monkeypatch.setattr(estimate, "frame", frame)
    with status.during_cycles("Cycles {}", window=True):
        status.engine.bar = 0.1
        status.engine.memory = 1.0
        assert b"0 %" not in status.engine.struct.raw  # nothing was heard yet
        time.sleep(0.5)
        assert status.engine.bar >= 0.7
        status("A background Blender", 0.5)
        assert b"Remaining" not in status.engine.struct.raw  # the line says it
    assert status.engine.memory > 50  # of this process, not what Cycles said last
    status("On", 0.5)
    assert status.engine.bar >= 0.7 and b"Remaining" in status.engine.struct.raw
