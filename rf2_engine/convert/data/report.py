# SPDX-License-Identifier: GPL-3.0-or-later
"""The report: what was approximated, skipped or refused, and why."""
from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from ....model.color import HALF_MAX

AS_GOOD_AS_INFINITE = 1e15  # squares of what is beyond do not fit into float32
SOME = 3                    # names in a sentence
_NUMBER = re.compile(r"\d+")


class Remark(NamedTuple):
    """One thing that the picture does not show as it is; as text, a sentence."""

    kind: str     # approximated, unplaced, skipped or refused
    name: str     # of the data-block
    message: str

    def __str__(self) -> str:
        return f"{self.kind} {self.name}: {self.message}"


class Group(NamedTuple):
    """Remarks that say the same of several things, but for numbers; as text, one sentence about all."""

    kind: str
    message: str  # with "..." for the numbers in which they differ
    remarks: list[Remark]

    @property
    def names(self) -> str:
        """The first few: "Tree, Rock, Leaf and 87 more"."""
        names = list(dict.fromkeys(remark.name for remark in self.remarks))
        return ", ".join(names[:SOME]) + (f" and {len(names) - SOME} more" if len(names) > SOME else "")

    def __str__(self) -> str:
        if len(self.remarks) == 1:
            return str(self.remarks[0])
        return f"{self.kind} {len(self.remarks)} ({self.names}): {self.message}"


def grouped(remarks: list[Remark]) -> list[Group]:
    """The remarks in groups, in the order of the first of each."""
    groups: dict[tuple[str, str], list[Remark]] = {}
    for remark in remarks:
        groups.setdefault((remark.kind, _NUMBER.sub("...", remark.message)), []).append(remark)
    return [Group(kind, alike[0].message if len({remark.message for remark in alike}) == 1 else pattern, alike)
            for (kind, pattern), alike in groups.items()]


class Report:
    """Collects each remark once, in the order in which they were made."""

    def __init__(self) -> None:
        self.entries: list[Remark] = []

    def approximated(self, name: str, message: str) -> None:
        """`name` is in the picture, but not exactly as Cycles shows it."""
        self._add("approximated", name, message)

    def unplaced(self, name: str, message: str) -> None:
        """`name` (or a part of it) is seen, but found no room in the scene that the network is given."""
        self._add("unplaced", name, message)

    def skipped(self, name: str, message: str) -> None:
        """`name` (or a part of it) is missing from the picture."""
        self._add("skipped", name, message)

    def refused(self, name: str, message: str) -> None:
        """`name` holds data that cannot be used, such as vertices that are not finite."""
        self._add("refused", name, message)

    def finite(self, name: str, what: str, values: np.ndarray) -> np.ndarray:
        """`values`, with 0 for NaN and the largest half float for (as good as) infinity; reported if there are any."""
        most = min(AS_GOOD_AS_INFINITE, float(np.finfo(values.dtype).max))
        if (np.abs(values) <= most).all():
            return values
        self.refused(name, f"{what} has values that are infinite or too large")
        known = np.nan_to_num(values, posinf=np.inf, neginf=-np.inf)
        known = np.where(np.abs(known) <= most, known, np.copysign(HALF_MAX, known))
        return known.astype(values.dtype)

    def add(self, entries: list[Remark]) -> None:
        """Remarks of another report."""
        for entry in entries:
            self._add(*entry)

    def lines(self) -> list[str]:
        """One sentence per remark, ready to print."""
        return [str(entry) for entry in self.entries]

    def _add(self, kind: str, name: str, message: str) -> None:
        entry = Remark(kind, name, message)
        if entry not in self.entries:
            self.entries.append(entry)
