# SPDX-License-Identifier: GPL-3.0-or-later
"""The reference while it is rendered: when there is something to draw, and what its label says."""
import time
from contextlib import contextmanager

import bpy
import pytest

import cycles.engine
from bl_ext.user_default.renderformer_v2.rf2_engine.compare.growing import growing_reference
from bl_ext.user_default.renderformer_v2.rf2_engine.cycles import growing

from tests.rf2_engine.f12 import press_f12


class Looks(list):
    """Of references; `traced` has the looks at our own picture."""


@pytest.fixture
def looks(monkeypatch):
    """What could be drawn while Cycles renders, once for each of its runs."""
    found, traced = Looks(), []
    found.traced = traced

    def render(engine, depsgraph, real=cycles.engine.render):
        real(engine, depsgraph)
        reference, ours = growing.running(), growing.running(is_reference=False)
        assert reference is None or ours is None
        traced.append(ours and (ours.layer, ours.width, ours.height, ours.samples()))
        found.append((growing._growing.engine is not None, reference, reference and reference.samples()))
    monkeypatch.setattr(cycles.engine, "render", render)
    return found


def test_only_the_reference_can_be_seen_while_cycles_renders_it(lit, tmp_path, looks):
    press_f12(lit, tmp_path)
    (_, camera_rays, _), (there, reference, samples) = looks
    assert camera_rays is None and there and samples == 4
    assert reference.layer == "ViewLayer" and (reference.width, reference.height) == (50, 37)
    assert reference.target_samples == 4 and reference.our_seconds > 0
    assert growing._growing.picture is None and growing._growing.engine is None


def test_the_light_of_our_own_picture_can_be_seen_while_cycles_traces_it(lit, tmp_path, looks):
    lit.renderformer_v2.guide_samples = 3
    press_f12(lit, tmp_path)
    assert looks.traced == [("ViewLayer", 50, 37, 3), None]  # and the reference
    looks.traced.clear()
    lit.renderformer_v2.light = "NETWORK"  # there is no light to be seen
    press_f12(lit, tmp_path)
    assert looks.traced == [None, None]


@pytest.mark.parametrize("crop", [False, True])
def test_a_render_region_is_drawn_from_where_cycles_draws_it(lit, tmp_path, looks, crop):
    lit.render.use_border, lit.render.use_crop_to_border = True, crop
    lit.render.border_min_x, lit.render.border_max_x, lit.render.border_min_y = 0.2, 0.8, 0.5
    press_f12(lit, tmp_path)
    reference = looks[-1][1]
    assert (reference.left, reference.bottom, reference.width, reference.height) == (10, 18, 30, 19)


def test_the_view_of_stereoscopy_that_is_rendered_is_known(lit, tmp_path, monkeypatch):
    lit.render.use_multiview, found = True, []
    monkeypatch.setattr(growing, "drawable", lambda engine, real=growing.drawable: look(real(engine)))

    @contextmanager
    def look(drawable):
        with drawable:
            yield
            found.append((growing._growing.picture is not None, growing.view()))
    bpy.ops.render.render()
    assert [number for is_drawn, number in found if is_drawn] == [1, 1]  # ours, the reference; both views are done
    assert growing.view() == 0


def test_nothing_is_left_to_be_drawn_when_cycles_fails(lit, tmp_path, monkeypatch):
    def fail(engine, depsgraph, real=cycles.engine.render, runs=[]):  # noqa: B006  the runs so far
        runs.append(engine)
        real(engine, depsgraph)
        if len(runs) == 2:
            raise MemoryError
    monkeypatch.setattr(cycles.engine, "render", fail)
    press_f12(lit, tmp_path)
    assert growing._growing.picture is None and growing._growing.engine is None


def test_before_the_first_sample_there_is_nothing(lit):
    samples = [0]
    reference = growing.CyclesPicture("ViewLayer", 50, 37, 7.24, lambda: samples[0], 128, time.perf_counter() - 12.3)
    assert growing.running() is None and growing_reference.labels() == ("RenderFormer-V2", "Cycles")
    with growing.announced(reference):
        assert growing.running() is None and growing.size() is None
        with growing.drawable(lit):
            assert growing.running() is None
            samples[0] = 24
            assert growing.running() == reference and growing.size() == (50, 37)
            assert growing_reference.labels() == ("RenderFormer-V2, 7.2 s", "Cycles, 24 of 128 samples, 12 s")
        assert growing.running() is None


def test_a_cycles_with_another_function_is_asked_once(lit, monkeypatch, capsys):
    asked = []

    def draw(engine, depsgraph):
        asked.append(engine)
    monkeypatch.setattr(cycles.engine, "draw", draw)
    reference = growing.CyclesPicture("ViewLayer", 50, 37, 1.0, lambda: 1, 2, 0.0)
    with growing.announced(reference), growing.drawable(lit):
        for _ in range(2):
            growing.draw(bpy.context)
        assert growing.running() is None
    assert not asked and capsys.readouterr().out.count("cannot be shown") == 1
