# SPDX-License-Identifier: GPL-3.0-or-later
"""Results of a conversion that the next one of an edited scene can use again."""
from __future__ import annotations

from collections.abc import Callable

from ....model.scene_rays import TreeCache
from .report import Remark, Report


class ConversionCache:
    """Results by their inputs, with the remarks that were made. What a conversion did not use is forgotten."""

    def __init__(self) -> None:
        self.trees = TreeCache()
        self._entries: dict[tuple, tuple[object, list[Remark]]] = {}
        self._used: dict[tuple, tuple[object, list[Remark]]] = {}

    def get(self, key: tuple, compute: Callable[[Report], object], report: Report):
        """compute(report), or the earlier result for the same key."""
        entry = self._entries.get(key) or self._used.get(key)
        if entry is None:
            own = Report()
            entry = compute(own), own.entries
        self._used[key] = entry
        report.add(entry[1])
        return entry[0]

    def begin(self) -> None:
        """Another conversion begins. A cancelled one leaves what it has computed."""
        self._entries |= self._used
        self._used = {}

    def end(self) -> None:
        self._entries, self._used = self._used, {}
