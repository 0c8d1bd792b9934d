# SPDX-License-Identifier: GPL-3.0-or-later
"""Progress reports from the code that works to the code that waits, without parameters in between.

    with reporting(listener):              # listener(text, fraction) may raise RenderCancelled
        with part(0.0, 0.5, "Stage 1"):    # what is reported inside fills this share of what surrounds it
            report(0.2)                    # listener("Stage 1", 0.1)
            for layer in steps(layers):    # each fills an equal share of it
                report()                   # no further than before: listener("Stage 1", 0.1), to let the user cancel

Everything that takes longer than 0.2 s reports at least that often, because Esc is checked there too.
"""
from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from typing import TypeVar

Listener = Callable[[str, float], None]
T = TypeVar("T")


class _Report:
    """What one listener has heard."""

    def __init__(self, listener: Listener):
        self.listener, self.latest = listener, 0.0

    def say(self, text: str, fraction: float) -> None:
        self.latest = fraction
        self.listener(text, fraction)


@dataclass(frozen=True)
class _Share:
    """The part of a report that the code at work fills."""

    report: _Report
    text: str = ""
    start: float = 0.0
    end: float = 1.0

    @property
    def begun(self) -> float:
        """How far it is."""
        latest = self.report.latest
        return latest if self.start <= latest <= self.end else self.start

    def at(self, fraction: float) -> float:
        return self.start + (self.end - self.start) * fraction

    def part(self, start: float, end: float, text: str | None) -> _Share:
        return replace(self, text=self.text if text is None else text, start=self.at(start), end=self.at(end))


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
    return _during(listener and _Share(_Report(listener)))


def part(start: float, end: float, text: str | None = None):
    """Inside, progress fills the share [start, end] of the surrounding one, under `text` or the surrounding text."""
    share = _share.get()
    return _during(share and share.part(start, end, text))


def standing_still():
    """Inside, progress is no further than before, whatever is reported: it only lets the user cancel."""
    share = _share.get()
    return _during(share and replace(share, start=share.begun, end=share.begun))


def steps(items: Collection[T], text: str = "") -> Iterator[T]:
    """The items, while each fills an equal share of the surrounding part, under "`text`, 2 of 12" or the text there.

    What ends the loop early must leave a surrounding `part`, which puts the share back.
    """
    surrounding, count = _share.get(), len(items)
    for i, item in enumerate(items):
        if surrounding is not None:
            _share.set(surrounding.part(i / count, (i + 1) / count, f"{text}, {i + 1} of {count}" if text else None))
            report(0.0)
        yield item
    if surrounding is not None:
        _share.set(surrounding)


def report(fraction: float | None = None, text: str | None = None) -> None:
    """Say how far the surrounding part is, 0 to 1, or that it is no further than before; the listener may raise to
    cancel.
    """
    share = _share.get()
    if share is None:
        return
    share.report.say(share.text if text is None else text, share.begun if fraction is None else share.at(fraction))
