# SPDX-License-Identifier: GPL-3.0-or-later
"""The line of text in a viewport that says what is shown."""
from __future__ import annotations

from ..runtime import running
from .session import NAMES, Session, Shown


def text(session: Session, waits: bool = False) -> str:
    """waits: a change of the scene is still being read."""
    if session.error:
        return session.error
    shown, request = session.shown, session.request
    now = "Paused while rendering" if running.is_under_way() else "Reading the scene" if waits else session.doing
    return " | ".join(filter(None, [_of(shown) if shown and (not request or shown.request.shows_as(request)) else "",
                                    now]))


def _of(shown: Shown) -> str:
    return f"{NAMES[shown.divisor].capitalize()}, {shown.seconds:.1f} s, {shown.triangles:,} triangles"
