# SPDX-License-Identifier: GPL-3.0-or-later
"""Which resolutions of a picture are drawn one after the other, coarse to fine."""
from __future__ import annotations

from collections.abc import Sequence

COARSEST = 8   # a side has one eighth of the pixels
QUICK = 0.28   # seconds of a picture that needs no coarser one before it
SMOOTH = 0.12  # the same while the view or the scene changes all the time
POWER = 1.6    # seconds grow with this power of the pixels along a side


def divisors(finest: int) -> tuple[int, ...]:
    """All levels down to `finest`, by what a side's pixels are divided by: 8, 4, 2, 1."""
    return tuple(divisor for divisor in (8, 4, 2, 1) if divisor >= min(finest, COARSEST))


def first(levels: Sequence[int], seconds: dict[int, float], is_dragged: bool = False) -> int:
    """Where to begin: the finest level that took so little time that it seems to be there at once."""
    quick = [divisor for divisor in levels if seconds.get(divisor, QUICK + 1) <= (SMOOTH if is_dragged else QUICK)]
    return quick[-1] if quick else levels[0]


def following(levels: Sequence[int], last: int, took: float, limit: float, seconds: dict[int, float]) -> int | None:
    """The level after `last`; None where that is the last one that fits into the limit.

    took: seconds of `last`. limit: seconds that a level may take, 0 = any. seconds: of levels that were drawn before.
    """
    finer = [divisor for divisor in levels if divisor < last]
    if not finer:
        return None
    expected = seconds.get(finer[0], took * (last / finer[0]) ** POWER)
    return None if limit and expected > limit else finer[0]
