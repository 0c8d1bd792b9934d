# SPDX-License-Identifier: GPL-3.0-or-later
"""Progress reports from the code that works to the code that waits, without parameters in between.

    with reporting(listener):              # listener(text, fraction) may raise RenderCancelled
        with part(0.0, 0.5, "Stage 1"):    # what is reported inside fills this share of what surrounds it
            report(0.2)                    # listener("Stage 1", 0.1)

Everything that takes longer than 0.2 s reports at least that often, because Esc is checked there too.
"""
from __future__ import annotations

from collections.abc import Callable
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace

Listener = Callable[[str, float], None]


@dataclass(frozen=True)
class _Share:
    listener: Listener
    text: str = ""
    start: float = 0.0
    end: float = 1.0

    def at(self, fraction: float) -> float:
        return self.start + (self.end - self.start) * fraction


_share: ContextVar[_Share | None] = ContextVar("share", default=None)


@contextmanager
def _during(share: _Share | None):
    token = _share.set(share)
    try:
        yield
    finally:
        _share.reset(token)


def reporting(listener: Listener | None):
    """Inside, `report` calls listener(text, fraction), and what that raises comes out; None silences it."""
    return _during(listener and _Share(listener))


def part(start: float, end: float, text: str | None = None):
    """Inside, progress fills the share [start, end] of the surrounding one, under `text` or the surrounding text."""
    share = _share.get()
    if share is None:
        return _during(None)
    return _during(replace(share, text=share.text if text is None else text, start=share.at(start), end=share.at(end)))


def report(fraction: float = 0.0, text: str | None = None) -> None:
    """Say how far the surrounding part is, 0 to 1; the listener may raise to cancel."""
    share = _share.get()
    if share is not None:
        share.listener(share.text if text is None else text, share.at(fraction))
