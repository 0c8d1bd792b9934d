# SPDX-License-Identifier: GPL-3.0-or-later
"""As many samples of Cycles as take a given time."""
import pytest

from tools.common.render_process import render, samples_in_time


def clock(fixed: float, per_sample: float):
    """A render that takes so long, and the counts that it was asked for."""
    asked = []

    def measure(samples: int) -> float:
        asked.append(samples)
        return fixed + per_sample * samples
    return measure, asked


@pytest.mark.parametrize("seconds, samples", [(8.5, 15), (2.0, 2), (100.0, 198), (1.0, 1)])
def test_samples_are_those_that_take_nearest_to_the_time(seconds, samples):
    measure, asked = clock(1.0, 0.5)
    assert samples_in_time(seconds, 4096, measure) == (samples, 1.0 + 0.5 * samples)
    assert len(asked) <= 3


@pytest.mark.parametrize("most", [1, 4, 24, 30])
def test_there_are_never_more_than_allowed_and_nothing_is_rendered_twice(most):
    measure, asked = clock(1.0, 0.01)
    assert samples_in_time(50.0, most, measure)[0] == most
    assert max(asked) == most and len(set(asked)) == len(asked)


def test_a_count_that_was_measured_nearer_wins_over_the_line():
    times = {4: 2.0, 12: 5.0, 15: 9.0}  # the machine was busy at 15
    assert samples_in_time(6.0, 256, times.__getitem__) == (12, 5.0)


def test_what_cannot_be_rendered_is_named(tmp_path):
    with pytest.raises(RuntimeError, match=r"none\.blend: .*there is no such file"):
        render(tmp_path / "none.blend", tmp_path / "out.exr")
