# SPDX-License-Identifier: GPL-3.0-or-later
"""A Rendered viewport in Blender's window; how to run it: test_session.py."""
import pytest

from tests.window.test_session import BLENDER, recorded

pytestmark = [pytest.mark.slow,
              pytest.mark.skipif(not BLENDER, reason="RENDERFORMER_V2_BLENDER names no Blender with a window")]


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    return recorded(tmp_path_factory.mktemp("viewport"), "viewport_session.py")


def test_rendered_shading_stays_and_shows_a_picture(found):
    assert found["entered"][:2] == ["RENDERED", 4] and found["entered"][2] > 0


def test_an_orbit_moves_the_view_and_reads_nothing(found):
    assert found["orbited"] == [True, True] and found["orthographic"]


def test_pictures_follow_a_drag_and_a_material(found):
    assert found["dragged"] > 1 and found["material"]


def test_seconds_of_our_pictures_and_those_of_cycles_are_measured(found):
    assert [(row["engine"], row["change"]) for row in found["measured"]] == [
        ("RenderFormer-V2", "camera"), ("RenderFormer-V2", "move"), ("RenderFormer-V2", "drag"), ("Solid", "drag"),
        ("Cycles", "camera"), ("Cycles", "move"), ("Cycles", "drag")]
    drags = [row for row in found["measured"] if row["change"] == "drag"]
    assert all(0 < row["first"] <= row["last"] for row in found["measured"] if row not in drags)
    assert all(drag["redraws"] > 0 for drag in drags) and drags[0]["pictures"] > 1


def test_a_small_window_is_drawn_ten_times_a_second_while_an_object_is_dragged(tmp_path):
    """Small, because without a graphics card it takes a processor longer than that to draw a large one."""
    ours, solid = recorded(tmp_path, "viewport_session.py", "drag", size=(800, 500))["measured"]
    assert ours["redraws"] > min(10, 0.6 * solid["redraws"]) and ours["pictures"] > 5


def test_nothing_that_is_done_in_between_is_an_error(found):
    said = found["said"]
    large = said.pop("large")
    assert not large or "Install Packages" in large  # which reduce it
    assert set(said.values()) == {""} and len(said) == 8 and found["two_windows"] == 2


def test_each_view_of_quad_view_is_drawn_and_freed(found):
    assert (found["quad"], found["single"]) == (4, 1)


def test_local_view_shows_what_is_in_it(found):
    assert (found["local"], found["global"]) == (1, 2)


def test_a_render_goes_on_beside_it_and_it_goes_on_afterwards(found):
    assert found["rendered"] == ["", False] and found["after_render"] == ""


def test_leaving_in_the_middle_of_work_harms_nothing(found):
    assert found["other_engine"] == 0 and found["other_file"] == ["", True] and found["enabled_again"] == ""
