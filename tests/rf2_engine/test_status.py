# SPDX-License-Identifier: GPL-3.0-or-later
"""One progress bar for a whole F12, which never runs backwards, and words about it that a user knows."""
import time

import bpy
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine import costs, estimate, memory
from bl_ext.user_default.renderformer_v2.rf2_engine.status import Status

from .f12 import cube, press_f12


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
    assert {"Reading objects, 1 of 2", "Gathering light, 4 of 4"} <= {text for _, text, _ in bar}


def test_every_frame_of_an_animation_begins_at_nothing(scene, tmp_path, bar):
    cube(scene)
    scene.frame_start, scene.frame_end, scene.render.filepath = 1, 2, str(tmp_path / "frame_")
    bpy.ops.render.render(animation=True, scene=scene.name)
    starts = [i for i, (_, text, _) in enumerate(bar)
              if text == "Converting the scene" and (i == 0 or bar[i - 1][2] == 1)]
    assert len(starts) == 2 and all(bar[i][2] < 0.5 for i in starts)


def test_a_stage_that_takes_longer_than_expected_stops_the_bar_short_of_its_end():
    costs.learn("First hits", 1, 0.01)
    frame = estimate.Frame()
    frame.begin_layer(1, {"First hits": 1})
    frame.begin_stage("First hits")
    frame.stage_begin -= 10
    frame.begin -= 10
    assert 1 < frame.remaining(0.0) < 10 and frame.bar < 0.95


def test_memory_counts_what_python_packages_hold():
    before, _ = memory.held()
    block = bytearray(200 << 20)
    block[::4096] = b"x" * len(block[::4096])
    now, most = memory.held()
    assert now - before > 150 and most >= now


def test_cycles_cannot_move_the_bar_back(monkeypatch):
    """Cycles' session sets it too, from 0 to 1; in a window somebody sets it right again."""
    class Engine:
        bar = 0.7

        def update_progress(self, fraction):
            self.bar = fraction

    status, frame = Status(Engine()), estimate.Frame(bar=0.7)
    monkeypatch.setattr(estimate, "frame", frame)
    with status.holding_the_bar(window=True):
        status.engine.bar = 0.1
        time.sleep(0.5)
        assert status.engine.bar >= 0.7
    assert status.engine.bar >= 0.7
