# SPDX-License-Identifier: GPL-3.0-or-later
"""Which resolutions of a picture are drawn one after the other, coarse to fine."""
from __future__ import annotations

from collections.abc import Sequence

COARSEST = 8   # a side has one eighth of the pixels
QUICK = 0.28   # seconds of a picture that nobody needs a coarser one before
SMOOTH = 0.12  # the same while the view or the scene changes all the time
POWER = 1.6    # of how many times as many pixels a side has, that seconds grow by


def divisors(finest: int) -> tuple[int, ...]:
    """All levels down to `finest`, by what a side's pixels are divided by: 8, 4, 2, 1."""
    return tuple(divisor for divisor in (8, 4, 2, 1) if divisor >= min(finest, COARSEST))


def first(levels: Sequence[int], seconds: dict[int, float], changing: bool = False) -> int:
    """Where to begin: the finest level that took so little time that it seems to be there at once."""
    quick = [divisor for divisor in levels if seconds.get(divisor, QUICK + 1) <= (SMOOTH if changing else QUICK)]
    return quick[-1] if quick else levels[0]


def following(levels: Sequence[int], done: int, took: float, limit: float, known: dict[int, float]) -> int | None:
    """The level after `done`, which took so many seconds; None where it is the last one that fits into the limit.

    limit: seconds that a level may take, 0 = any. known: what levels took before.
    """
    finer = [divisor for divisor in levels if divisor < done]
    if not finer:
        return None
    expected = known.get(finer[0], took * (done / finer[0]) ** POWER)
    return None if limit and expected > limit else finer[0]
