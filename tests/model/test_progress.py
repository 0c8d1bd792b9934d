# SPDX-License-Identifier: GPL-3.0-or-later
"""Progress reaches the listener through functions that know nothing of it."""
import pytest

from renderformer_v2.model import progress
from renderformer_v2.model.errors import RenderCancelled


def test_parts_nest_and_keep_the_surrounding_text_unless_they_have_their_own():
    heard = []
    with progress.reporting(lambda *said: heard.append(said)):
        with progress.part(0.5, 1.0, "outer"):
            progress.report(0.5)
            with progress.part(0.5, 1.0):
                progress.report(0.5)
            progress.report(1.0, "own")
        progress.report(0.25)
    assert heard == [("outer", 0.75), ("outer", 0.875), ("own", 1.0), ("", 0.25)]


def test_nobody_hears_outside_and_a_part_can_be_silenced():
    heard = []
    progress.report(0.5)
    with progress.part(0, 1, "nobody"):
        progress.report(0.5)
    with progress.reporting(lambda *said: heard.append(said)):
        with progress.reporting(None):
            progress.report(0.5)
    assert not heard


def test_after_a_cancellation_the_surroundings_are_restored():
    heard = []

    def cancel(text, fraction):
        raise RenderCancelled

    with progress.reporting(lambda *said: heard.append(said)):
        with pytest.raises(RenderCancelled), progress.reporting(cancel), progress.part(0, 0.5):
            progress.report()
        progress.report(0.5, "again")
    assert heard == [("again", 0.5)]


def test_steps_share_the_surrounding_part_and_a_report_without_a_fraction_goes_on_from_the_last():
    heard = []
    with progress.reporting(lambda *said: heard.append(said)):
        with progress.part(0.5, 1.0, "outer"):
            for fraction in progress.steps([0.25, 0.5], "Layer"):
                progress.report(fraction)
                progress.report()
            progress.report()
        progress.report(0.0)
    assert heard == [("Layer, 1 of 2", 0.5), *[("Layer, 1 of 2", 0.5625)] * 2,
                     ("Layer, 2 of 2", 0.75), *[("Layer, 2 of 2", 0.875)] * 2, ("outer", 0.875), ("", 0.0)]


def test_a_loop_of_steps_that_is_left_early_does_not_outlive_the_surrounding_part():
    heard = []
    with progress.reporting(lambda *said: heard.append(said)):
        with pytest.raises(RenderCancelled), progress.part(0.0, 0.5):
            for _ in progress.steps([1, 2], "Layer"):
                raise RenderCancelled
        progress.report(1.0, "after")
    assert heard == [("Layer, 1 of 2", 0.0), ("after", 1.0)]
