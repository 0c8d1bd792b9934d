# SPDX-License-Identifier: GPL-3.0-or-later
"""The report: what was approximated, skipped or refused, and why."""
from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from ....model.pictures import HALF_MAX

AS_GOOD_AS_INFINITE = 1e15  # squares of what is beyond do not fit into float32
SOME = 3                    # names in a sentence
KINDS = ("refused", "skipped", "unplaced", "approximated")  # the most important first
_NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?")


class Remark(NamedTuple):
    """One difference between the picture and the scene; as text, a sentence."""

    kind: str     # one of KINDS
    name: str     # of the data-block
    message: str

    def __str__(self) -> str:
        return f"{self.kind} {self.name}: {self.message}"


class Group(NamedTuple):
    """Remarks that say the same of several data-blocks, perhaps with other numbers; as text, one sentence."""

    kind: str
    message: str  # where numbers differ, from the least to the largest: "simplified from 168 to 12–16 triangles"
    remarks: list[Remark]  # those with the largest numbers first, where numbers differ

    @property
    def names(self) -> str:
        return list_names(self.remarks)

    def __str__(self) -> str:
        if len(self.remarks) == 1:
            return str(self.remarks[0])
        return f"{self.kind} {len(self.remarks)} ({self.names}): {self.message}"


def list_names(remarks: list[Remark]) -> str:
    """The first few: "Tree, Rock, Leaf and 87 more"."""
    names = list(dict.fromkeys(remark.name for remark in remarks))
    return ", ".join(names[:SOME]) + (f" and {len(names) - SOME} more" if len(names) > SOME else "")


def grouped(remarks: list[Remark]) -> list[Group]:
    """The remarks in groups, the most important kinds first, and within a kind in the order in which they were made.

    Equal messages are one group; messages that differ only in numbers are one if there are more than SOME remarks.
    """
    patterns: dict[tuple[str, str], list[Remark]] = {}
    for remark in remarks:
        patterns.setdefault((remark.kind, _NUMBER.sub("0", remark.message)), []).append(remark)
    groups = []
    for alike in patterns.values():
        messages: dict[str, list[Remark]] = {}
        for remark in alike:
            messages.setdefault(remark.message, []).append(remark)
        if len(alike) > SOME:
            alike.sort(key=_numbers, reverse=True)
            messages = {_merge(list(messages)): alike}
        groups += [Group(alike[0].kind, message, same) for message, same in messages.items()]
    return sorted(groups, key=lambda group: KINDS.index(group.kind))


def _numbers(remark: Remark) -> list[float]:
    return [float(number) for number in _NUMBER.findall(remark.message)]


def _merge(messages: list[str]) -> str:
    """One message for several that differ only in numbers."""
    columns = zip(*(_NUMBER.findall(message) for message in messages), strict=True)
    ranges = iter([sorted(column, key=float) for column in columns])
    return _NUMBER.sub(lambda _: "–".join(dict.fromkeys(next(ranges)[::len(messages) - 1 or 1])), messages[0])


class Report:
    """Collects remarks, each once, in the order in which they are made."""

    def __init__(self) -> None:
        self.entries: list[Remark] = []
        self._unique: set[Remark] = set()

    def approximated(self, name: str, message: str) -> None:
        """`name` is in the picture, but not exactly as Cycles shows it."""
        self._add("approximated", name, message)

    def unplaced(self, name: str, message: str) -> None:
        """`name` (or a part of it) is visible, but there is no room for it among the triangles of the network."""
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
        numbers = np.nan_to_num(values, posinf=np.inf, neginf=-np.inf)
        numbers = np.where(np.abs(numbers) <= most, numbers, np.copysign(HALF_MAX, numbers))
        return numbers.astype(values.dtype)

    def add(self, entries: list[Remark]) -> None:
        """Remarks of another report."""
        for entry in entries:
            self._add(*entry)

    def lines(self) -> list[str]:
        """One sentence per remark, ready to print."""
        return [str(entry) for entry in self.entries]

    def _add(self, kind: str, name: str, message: str) -> None:
        entry = Remark(kind, name, message)
        if entry not in self._unique:
            self._unique.add(entry)
            self.entries.append(entry)
