# SPDX-License-Identifier: GPL-3.0-or-later
"""What renders cost is learned by setup, kept between sessions, and unknown before it was measured."""
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.progress import costs
from bl_ext.user_default.renderformer_v2.rf2_engine.progress.stages import ENCODE, FIRST_HITS, LOAD, VIEW, Work


@pytest.fixture(autouse=True)
def nothing_learned(monkeypatch):
    monkeypatch.setattr(costs, "_measured", {})
    monkeypatch.setattr(costs, "_memory", {})


def test_what_a_stage_took_is_what_it_is_expected_to_take():
    costs.learn(FIRST_HITS, 1000, 5.0, "CPU")
    assert costs.seconds(FIRST_HITS, 2000, "CPU") == pytest.approx(10)
    assert costs.seconds(FIRST_HITS, 2000, "GPU") == pytest.approx(10)  # better than any guess
    assert costs.measured_seconds({FIRST_HITS: Work(2000)}, "CPU") == pytest.approx(10)
    assert costs.measured_seconds({FIRST_HITS: Work(2000)}, "GPU") is None


def test_what_is_not_to_be_done_needs_no_measurement():
    costs.learn(FIRST_HITS, 1000, 5.0, "CPU")
    work = {FIRST_HITS: Work(500, 2), LOAD: Work(0), VIEW: Work(1, 0)}
    assert costs.measured_seconds(work, "CPU") == pytest.approx(5)
    assert costs.measured_seconds(work | {VIEW: Work(1)}, "CPU") is None


def test_a_stage_that_was_already_done_is_not_expected_to_be_so_again():
    costs.learn(ENCODE, 1000, 8.0)
    costs.learn(ENCODE, 1000, 0.0)
    assert costs.seconds(ENCODE, 1000) == pytest.approx(4)


def test_memory_grows_with_the_picture_or_the_scene():
    assert costs.measured_memory("CPU", True, 100, 10) is None
    costs.learn_memory("CPU", False, 500.0, 100, 10)
    assert costs.measured_memory("CPU", True, 100, 10) == 500  # the network is among it
    costs.learn_memory("CPU", True, 300.0, 100, 10)
    assert costs.measured_memory("CPU", True, 50, 5) == 300
    assert costs.measured_memory("CPU", True, 200, 10) == 600
    assert costs.measured_memory("CPU", True, 100, 40) == 1200


def test_what_was_measured_is_known_in_the_next_session(monkeypatch):
    costs.learn(FIRST_HITS, 1000, 5.0, "CPU")
    costs.learn_memory("CPU", True, 300.0, 100, 10)
    costs.save()
    monkeypatch.setattr(costs, "_measured", {})
    monkeypatch.setattr(costs, "_memory", {})
    costs.load()
    assert costs.measured_seconds({FIRST_HITS: Work(2000)}, "CPU") == pytest.approx(10)
    assert costs.measured_memory("CPU", True, 100, 10) == 300


@pytest.mark.parametrize("content", ["", "{", "[]", '{"seconds": 3, "memory": {}}', '{"seconds": {"a": {"b": "c"}}}'])
def test_a_broken_file_is_as_good_as_none(content):
    costs._file().write_text(content)
    costs.load()
    assert costs.measured_seconds({FIRST_HITS: Work(1)}, "CPU") is None


def test_only_the_latest_setups_are_kept():
    for i in range(costs.MOST_SETUPS + 5):
        costs.learn(FIRST_HITS, 1, 1.0, str(i))
    assert costs.measured_seconds({FIRST_HITS: Work(1)}, "4") is None
    assert costs.measured_seconds({FIRST_HITS: Work(1)}, "5") == 1
