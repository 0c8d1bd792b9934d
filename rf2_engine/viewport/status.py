# SPDX-License-Identifier: GPL-3.0-or-later
"""The line of text in a viewport that says what is shown."""
from __future__ import annotations

from ..runtime import running
from .session import NAMES, DisplayedPicture, Session


def status_text(session: Session, is_reading: bool = False) -> str:
    """is_reading: a change of the scene is still being read."""
    if session.error:
        return session.error
    picture, request = session.displayed, session.request
    activity = ("Paused while rendering" if running.is_under_way() else
                "Reading the scene" if is_reading else session.activity)
    is_current = picture and (not request or picture.request.looks_like(request))
    return " | ".join(filter(None, [_describe(picture) if is_current else "", activity]))


def _describe(picture: DisplayedPicture) -> str:
    size = "Full resolution" if picture.divisor == 1 else f"Resolution {NAMES[picture.divisor]}"
    return f"{size} · {picture.seconds:.1f} s · {picture.triangles:,} triangles"
