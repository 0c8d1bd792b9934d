# SPDX-License-Identifier: GPL-3.0-or-later
"""Texts in panels are never cut."""
import blf
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.setup.display import wrap

TEXT = ("Slot 1 has no pass 'Cycles Reference'. Choose one of: Combined, Depth, Diffuse Color, iiiii, WWWWWWWWWW, "
        "/a/folder/with/a/name/that/no/panel/is/wide/enough/for/ (WWWWW)")


@pytest.mark.parametrize("width", [60, 210, 2000])
def test_every_line_fits_and_no_letter_is_lost(width):
    blf.size(0, 11)
    lines = wrap(TEXT, width)
    assert max(blf.dimensions(0, line)[0] for line in lines) <= width
    assert "".join(lines).replace(" ", "") == TEXT.replace(" ", "")
    assert width < 2000 or lines == [TEXT]


def test_a_panel_of_no_width_has_a_letter_to_a_line():
    assert wrap("ab c", 0) == list("abc")
