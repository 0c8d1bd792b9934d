# SPDX-License-Identifier: GPL-3.0-or-later
"""When the reference is rendered, when it ends, and what is left of it: our picture always, seconds and samples."""
import gc
import weakref

import numpy as np
import OpenEXR
import pytest
import torch

from bl_ext.user_default.renderformer_v2.model.errors import RenderCancelled
from bl_ext.user_default.renderformer_v2.rf2_engine import passes
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.report import Report
from bl_ext.user_default.renderformer_v2.rf2_engine.cycles import run as cycles_run
from bl_ext.user_default.renderformer_v2.rf2_engine.frame import reference
from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render
from bl_ext.user_default.renderformer_v2.rf2_engine.progress.cycles_text import EngineText
from bl_ext.user_default.renderformer_v2.rf2_engine.progress.status import Status
from bl_ext.user_default.renderformer_v2.rf2_engine.reference_settings import FrameReference
from bl_ext.user_default.renderformer_v2.rf2_engine.runtime import model_cache

from tests.rf2_engine.f12 import press_f12

REFERENCE = "ViewLayer.Cycles Reference"


def test_without_the_checkbox_cycles_runs_once(lit, tmp_path, monkeypatch):
    runs = spy(monkeypatch)
    lit.renderformer_v2.reference.use = False
    assert REFERENCE not in press_f12(lit, tmp_path)
    assert len(runs) == 1 and last_render.last_frame[0].reference_samples == 0
    lit.renderformer_v2.reference.use = True
    press_f12(lit, tmp_path)
    assert len(runs) == 3


def spy(monkeypatch, instead=None) -> list:
    """The runs of Cycles to come; `instead` takes the place of what the second one returns."""
    runs = []

    def read(*arguments, real=cycles_run._read):
        runs.append(arguments)
        return instead() if instead and len(runs) == 2 else real(*arguments)
    monkeypatch.setattr(cycles_run, "_read", read)
    return runs


def test_our_picture_is_on_screen_before_cycles_starts(lit, tmp_path, monkeypatch):
    shown = []

    def look(status):
        if status._displayed[0].endswith("Cycles Reference") and not shown:
            read = cycles_run._read(status.engine.get_result(), "ViewLayer", [passes.PASSES[0]], True)
            shown.append(read[""]["combined"])
        return False
    monkeypatch.setattr(Status, "esc_pressed", look)
    found = press_f12(lit, tmp_path)
    np.testing.assert_array_equal(shown[0], found["ViewLayer.Combined"])


def stop():
    raise RenderCancelled()


def fail():
    raise MemoryError()


@pytest.mark.parametrize("persistent", [False, True])
@pytest.mark.parametrize("end, reason", [(stop, "stopped"), (fail, "Out of memory")])
def test_our_picture_stays_when_the_reference_ends_early(lit, tmp_path, monkeypatch, persistent, end, reason):
    """Cycles has written its own picture over ours by then."""
    lit.render.use_persistent_data = persistent
    whole = press_f12(lit, tmp_path)
    with monkeypatch.context() as broken:
        spy(broken, instead=end)
        found = press_f12(lit, tmp_path)
    np.testing.assert_array_equal(found["ViewLayer.Combined"], whole["ViewLayer.Combined"])
    assert (found[REFERENCE] == 0).all()
    (last,) = last_render.last_frame
    assert any("Cycles Reference" in line and reason in line for line in last.report) and last.reference_samples == 0
    np.testing.assert_array_equal(press_f12(lit, tmp_path)[REFERENCE], whole[REFERENCE])


@pytest.fixture
def pressed_esc(monkeypatch):
    """Esc as Python sees it while the reference is rendered; Cycles does not hear of it."""
    pressed = []
    monkeypatch.setattr(Status, "esc_pressed", lambda status: bool(pressed))

    def press(*arguments, real=reference._render):
        pressed.append(True)
        return real(*arguments)
    monkeypatch.setattr(reference, "_render", press)


@pytest.mark.parametrize("denoise", [False, True])
def test_a_reference_that_is_stopped_keeps_its_samples_so_far(lit, tmp_path, pressed_esc, monkeypatch, denoise):
    def until_esc(text, real=EngineText.read):
        return real(text).replace("Finished", "")
    monkeypatch.setattr(EngineText, "read", until_esc)
    chosen = lit.renderformer_v2.reference
    chosen.use_denoising, chosen.samples, lit.cycles.use_adaptive_sampling = denoise, 2048, False
    found = press_f12(lit, tmp_path)
    (last,) = last_render.last_frame
    assert found[REFERENCE].any() and 0 < last.reference_samples < 2048 and last.reference_seconds > 0
    assert any(f"stopped after {last.reference_samples} of 2048 samples" in line and ("not denoised" in line) == denoise
               for line in last.report)
    with OpenEXR.File(str(tmp_path / "picture.exr")) as file:
        assert dict(file.header())["ViewLayer.Cycles Reference.samples"] == str(last.reference_samples)


def test_a_reference_that_is_stopped_after_its_last_sample_is_whole(lit, tmp_path, pressed_esc):
    press_f12(lit, tmp_path)
    (last,) = last_render.last_frame
    assert last.reference_samples == 4 and not any("stopped" in line for line in last.report)


@pytest.mark.parametrize("samples, same, kept", [(0, False, False), (3, True, False), (3, False, True)])
def test_what_cycles_did_not_write_is_no_reference(lit, samples, same, kept):
    """Combined is still ours until it writes its first samples."""
    picture = np.full((2, 2, 4), np.nan, np.float32)
    rendered = {"cycles_reference": picture.copy() if same else np.ones_like(picture)}
    found = reference._stopped_reference({"": rendered}, samples, {"": {"combined": picture}},
                                         FrameReference.read(lit), report := Report())
    assert bool(found) == kept and len(report.entries) == 1


def test_a_reference_of_two_views_has_both_or_is_none(lit):
    ours = {"combined": np.zeros((2, 2, 4), np.float32)}
    theirs = {"cycles_reference": np.ones((2, 2, 4), np.float32)}
    chosen = FrameReference.read(lit)
    views = {"left": ours, "right": ours}
    assert reference._stopped_reference({"left": theirs, "right": theirs}, 3, views, chosen, Report())
    half = {"left": theirs, "right": {"cycles_reference": ours["combined"]}}
    assert not reference._stopped_reference(half, 3, views, chosen, Report())


def test_esc_before_cycles_starts_keeps_our_picture(lit, tmp_path, monkeypatch):
    whole = press_f12(lit, tmp_path)["ViewLayer.Combined"]
    monkeypatch.setattr(Status, "esc_pressed", lambda status: status._displayed[0].endswith("Cycles Reference"))
    np.testing.assert_array_equal(press_f12(lit, tmp_path)["ViewLayer.Combined"], whole)
    assert any("stopped" in line for line in last_render.last_frame[0].report)


def test_seconds_and_samples_are_kept_and_in_the_file(lit, tmp_path):
    press_f12(lit, tmp_path)
    (last,) = last_render.last_frame
    assert last.reference_seconds > 0 and last.picture_seconds > 0 and last.reference_samples == 4
    assert last.picture_seconds + last.reference_seconds == pytest.approx(sum(last.seconds.values()))
    with OpenEXR.File(str(tmp_path / "picture.exr")) as file:
        header = dict(file.header())
    assert header["RenderFormer-V2 seconds"] == f"{last.picture_seconds:.2f}"
    assert header["Cycles Reference seconds"] == f"{last.reference_seconds:.2f}"
    assert header["Cycles Reference samples"] == "4"


def test_a_time_limit_ends_the_reference(lit, tmp_path):
    chosen = lit.renderformer_v2.reference
    chosen.samples, chosen.time_limit = 1 << 20, 0.5
    lit.cycles.use_adaptive_sampling = False  # a million samples would take minutes
    assert press_f12(lit, tmp_path)[REFERENCE][15:22, 20:30, :3].min() > 0
    assert lit.cycles.time_limit == 0 and any("Time Limit" in line for line in last_render.last_frame[0].report)
    chosen.samples, chosen.time_limit = 1, 1000
    press_f12(lit, tmp_path)
    assert not any("Time Limit" in line for line in last_render.last_frame[0].report)


@pytest.mark.parametrize("device", ["CPU", "GPU"])
def test_the_network_leaves_the_gpu_to_the_reference(lit, tmp_path, monkeypatch, device):
    """The network is on the processor here, and only says that it is on a GPU."""
    lit.cycles.device = device
    press_f12(lit, tmp_path)
    (renderer,) = model_cache._cached.values()
    renderer.device = torch.device("mps")  # has no driver that would be asked for its name
    kept, there = [weakref.ref(each) for each in (renderer, *model_cache._encoded.values())], []
    del renderer

    def read(*arguments, real=cycles_run._read):
        gc.collect()
        there.append([each() is not None for each in kept])
        return real(*arguments)
    monkeypatch.setattr(cycles_run, "_read", read)
    press_f12(lit, tmp_path)
    model_cache.free()
    assert there == [[True, True], [device == "CPU"] * 2]
