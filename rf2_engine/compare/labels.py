# SPDX-License-Identifier: GPL-3.0-or-later
"""What the two pictures are called where they are shown: all that is known of them, or what tells them apart."""
from __future__ import annotations

from collections.abc import Callable, Iterable

from .. import passes as pass_table
from .sources import Picture

USUAL = ("Combined", *pass_table.REFERENCE_NAMES)  # passes that need no mention beside the engine that made them


def of_pictures(a: Picture, b: Picture, layered: bool) -> list[tuple[str, str]]:
    """Labels of both, the longest first. layered: whether there are several view layers."""
    return [(a.label, b.label), (_short(a, b, layered), _short(b, a, layered))]


def _short(picture: Picture, other: Picture, layered: bool) -> str:
    """Without what both have in common and the header of the Image Editor says."""
    if not picture.credits.engine or picture.credits == other.credits:
        return picture.name
    where, layer, of, view = (*picture.place, "", "", "")[:4]
    where_other, layer_other, *_ = (*other.place, "")
    said = [where if where != where_other else "", layer if layered or layer != layer_other else "",
            of if of not in USUAL else "", view]
    more = ", ".join(filter(None, said))
    return f"{picture.credits} ({more})" if more else str(picture.credits)


def longest(labels: Iterable[tuple[str, str]], fits: Callable[[str, str], bool]) -> tuple[str, str]:
    """The first pair that `fits`, or else the last."""
    for pair in labels:
        if fits(*pair):
            break
    return pair
