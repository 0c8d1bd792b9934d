# SPDX-License-Identifier: GPL-3.0-or-later
"""Coarse pictures come first, and finer ones as far as they are wanted and fit into the time."""
from bl_ext.user_default.renderformer_v2.rf2_engine.viewport.levels import QUICK, SMOOTH, divisors, first, following


def test_levels_end_at_the_maximum_resolution():
    assert divisors(1) == (8, 4, 2, 1) and divisors(4) == (8, 4) and divisors(8) == (8,)


def test_the_coarsest_comes_first_until_a_finer_one_is_known_to_be_quick():
    assert first((8, 4, 2, 1), {}) == 8
    assert first((8, 4, 2, 1), {8: 0.1, 4: QUICK, 2: 0.9}) == 4


def test_while_something_is_dragged_pictures_are_coarse_unless_finer_ones_are_smooth():
    assert first((8, 4, 2, 1), {8: 0.1, 4: QUICK, 2: 0.9}, is_dragged=True) == 8
    assert first((8, 4, 2, 1), {8: 0.02, 4: SMOOTH, 2: 0.9}, is_dragged=True) == 4


def test_each_level_follows_the_one_before():
    assert [following((8, 4, 2), done, 0.1, 0, {}) for done in (8, 4, 2)] == [4, 2, None]


def test_levels_that_take_too_long_are_left_out():
    assert following((8, 4, 2, 1), 4, 2.0, 5.0, {}) is None       # about six seconds
    assert following((8, 4, 2, 1), 4, 2.0, 5.0, {2: 4.0}) == 2    # which was measured before
    assert following((8, 4, 2, 1), 4, 2.0, 5.0, {2: 6.0}) is None
