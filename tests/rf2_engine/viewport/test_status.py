# SPDX-License-Identifier: GPL-3.0-or-later
"""The line of text in a viewport says what is shown, and what is being done."""
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.viewport.session import DisplayedPicture, Session
from bl_ext.user_default.renderformer_v2.rf2_engine.viewport.status import status_text


@pytest.mark.parametrize("divisor, line", [(2, "Resolution 1/2 · 12.4 s · 2,048 triangles"),
                                           (1, "Full resolution · 12.4 s · 2,048 triangles")])
def test_a_picture_has_its_resolution_seconds_and_triangles(divisor, line):
    session = Session()
    session.displayed = DisplayedPicture(pixels=None, request=None, divisor=divisor, seconds=12.44, triangles=2048)
    assert status_text(session) == line
    assert status_text(session, is_reading=True) == f"{line} | Reading the scene"
