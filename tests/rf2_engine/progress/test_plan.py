# SPDX-License-Identifier: GPL-3.0-or-later
"""A stage is entered in one place, which times it, shows it, looks at Esc and remembers what it cost."""
import pytest

from bl_ext.user_default.renderformer_v2.model import progress
from bl_ext.user_default.renderformer_v2.model.errors import RenderCancelled
from bl_ext.user_default.renderformer_v2.rf2_engine.frame import optics, work
from bl_ext.user_default.renderformer_v2.rf2_engine.frame_settings import FrameSettings
from bl_ext.user_default.renderformer_v2.rf2_engine.progress import costs, estimate, stages
from bl_ext.user_default.renderformer_v2.rf2_engine.progress.plan import Plan
from bl_ext.user_default.renderformer_v2.rf2_engine.progress.stages import ENCODE, FIRST_HITS, LOAD, SAMPLE_HITS, Work

WORK = {LOAD: Work(1), FIRST_HITS: Work(100), SAMPLE_HITS: Work(10, 4), ENCODE: Work(4096)}


@pytest.fixture
def plan(monkeypatch):
    monkeypatch.setattr(costs, "_measured", {})
    monkeypatch.setattr(costs, "_memory", {})
    monkeypatch.setattr(estimate, "frame", estimate.Frame())
    for stage, work_of in WORK.items():
        costs.learn(stage, work_of.units, 1.0, "CPU")
    return Plan(WORK, "CPU")


def test_a_stage_says_its_text_and_its_seconds_are_added_to_those_with_the_same(plan):
    said = []
    with progress.reporting(lambda text, fraction: said.append((text, fraction))):
        for stage in (FIRST_HITS, SAMPLE_HITS):
            with plan.enter(stage):
                progress.report(0.5)
    assert said == 2 * [("Camera rays", 0.0), ("Camera rays", 0.5), ("Camera rays", 1.0)]
    assert set(plan.seconds) == {"Camera rays"} and plan.seconds["Camera rays"] > 0


def test_each_of_several_entries_takes_its_share_of_what_was_expected(plan):
    for left in (3, 2, 1, 0):
        with plan.enter(SAMPLE_HITS):
            assert estimate.frame.expected[SAMPLE_HITS] == pytest.approx(left)
            assert estimate.frame.stage_expected == pytest.approx(1)


def test_what_a_stage_took_is_remembered_for_a_unit_of_its_work(plan):
    with plan.enter(SAMPLE_HITS):
        pass
    assert costs.seconds(SAMPLE_HITS, 10, "CPU") == pytest.approx(costs.LEAST_LEARNED)
    assert costs.seconds(FIRST_HITS, 100, "CPU") == pytest.approx(1)


def test_a_stage_is_not_entered_after_esc(plan):
    def pressed(text, fraction):
        raise RenderCancelled
    entered = []
    with progress.reporting(pressed), pytest.raises(RenderCancelled):
        with plan.enter(ENCODE):
            entered.append(True)
    assert not entered and costs.seconds(ENCODE, 4096, "CPU") == pytest.approx(1)


def test_what_need_not_be_done_is_not_waited_for(plan):
    plan.skip(SAMPLE_HITS)
    assert estimate.frame.expected[SAMPLE_HITS] == 0


def test_fewer_triangles_than_the_budget_take_less_time(plan):
    plan.set_triangles(1024)
    assert estimate.frame.expected[ENCODE] == pytest.approx(0.25)
    with plan.enter(ENCODE):
        pass
    assert costs.seconds(ENCODE, 1024, "CPU") == pytest.approx(0.25 * costs.LEAST_LEARNED)


def test_every_stage_has_work_in_the_order_of_a_frame_and_a_cost_of_its_own(scene):
    everything = optics.Optics(lens_samples=4, shutter_samples=2, transparent_glass=True, holdouts=True,
                                shadow_catchers=True)
    scene.renderformer_v2.reference.use = True
    pictures = work.Pictures(50 * 37, views=1, with_lobes=True, groups=0)
    to_do = work.stage_work(pictures, FrameSettings.read(scene), everything)
    table = [each for each in vars(stages).values() if isinstance(each, stages.Stage)]
    assert list(to_do) == table
    assert len({stage.key for stage in table}) == len(table) and all(stage.first_guess > 0 for stage in table)
    assert (to_do[stages.CATCHERS].times, to_do[SAMPLE_HITS].times, to_do[stages.CONVERT].times) == (2, 4, 3)
