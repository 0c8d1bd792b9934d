# SPDX-License-Identifier: GPL-3.0-or-later
"""Side by Side: both halves show the same part, however the editor is zoomed and panned."""
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.compare import halves


@pytest.mark.parametrize("begin", [-3000.0, -90.0, 20.0, 300.0, 390.0])
@pytest.mark.parametrize("width", [100.0, 350.0, 5000.0])
def test_both_halves_show_the_same_part_at_the_same_place(begin, width):
    left, right = 40, 840
    found, half = halves.divide(begin, width, left, right), (right - left) / 2
    pixel = np.arange(half)                            # of a half
    in_a = (left + pixel - begin) / width              # what Blender draws there
    in_b = (left + half + pixel - begin) / width - found.shift
    np.testing.assert_allclose(in_b, in_a, atol=1e-9)
    drawn_a = (left + np.arange(right - left) - begin) / width
    assert drawn_a[int(half):].min() >= found.end_of_a - 1e-9 or found.end_of_a == 1
    visible = (in_b > 0) & (in_b < 1)
    assert not visible.any() or in_b[visible].min() >= found.begin_b - 1e-9
    outside = (left + np.arange(half) - begin) / width - found.shift  # of B, in the left half
    assert outside.max() <= found.begin_b + 1e-9 or found.begin_b == 1
