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


# MiB that first renders of Blender sessions added, with pixels and triangles: a cube, and a room (docs/measured.md 7)
FIRST_RENDERS = [
    (1068, 480 * 270, 780), (3914, 1920 * 1080, 780), (1094, 480 * 270, 924), (1886, 960 * 540, 924),
    (1873, 960 * 540, 16384), (4283, 1920 * 1080, 924), (1176, 480 * 270, 4096), (1179, 480 * 270, 16384),
    (999, 240 * 135, 16384), (1107, 240 * 135, 65536)]


@pytest.mark.parametrize("before", FIRST_RENDERS, ids=str)
@pytest.mark.parametrize("after", FIRST_RENDERS, ids=str)
def test_one_render_tells_the_memory_of_any_other_and_no_less(before, after):
    costs.learn_memory("CPU", False, *before)
    needed, *size = after
    assert 0.9 * needed < costs.measured_memory("CPU", False, *size) < 1.8 * needed


def test_memory_of_the_picture_is_not_multiplied_with_that_of_the_scene():
    costs.learn_memory("CPU", False, 4600.0, 1920 * 1080, 780)
    assert costs.measured_memory("CPU", True, 480 * 270, 2882) < 1000  # it was 17000
    assert costs.measured_memory("CPU", True, 480 * 270, 2882) > 320


def test_memory_that_a_scene_needs_beyond_the_usual_stays_in_small_pictures():
    costs.learn_memory("CPU", True, 30000.0, 1920 * 1080, 4096)
    assert costs.measured_memory("CPU", True, 480 * 270, 4096) > 25000


def test_the_same_render_again_adds_what_it_added():
    assert costs.measured_memory("CPU", True, 100, 10) is None
    costs.learn_memory("CPU", False, 1500.0, 100, 10)
    assert costs.measured_memory("CPU", False, 100, 10) == 1500
    assert costs.measured_memory("CPU", True, 100, 10) < 1500  # the network is there
    costs.learn_memory("CPU", True, 300.0, 100, 10)
    assert costs.measured_memory("CPU", True, 100, 10) == 300
    assert costs.measured_memory("CPU", True, 50, 5) == pytest.approx(300, abs=1)


def test_large_networks_need_more_for_each_triangle():
    costs.learn_memory("CPU", True, 3000.0, 100, 1000)
    grown = [costs.measured_memory("CPU", True, 100, 2000, is_published) for is_published in (False, True)]
    assert 3000 < grown[0] < grown[1]


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
