# SPDX-License-Identifier: GPL-3.0-or-later
"""A cache of latents by a hash of their inputs: in memory, or in a file for later renders."""
from __future__ import annotations

import time
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

LIMIT = 1 << 28  # bytes; 100,000 tiles
REMAINING = 0.75  # share that remains when it was full
BATCH = 500      # keys in a query; SQLite takes 999
DAY = 86400
SCHEMA = ("CREATE TABLE IF NOT EXISTS latents (key BLOB PRIMARY KEY, day INTEGER NOT NULL, value BLOB NOT NULL)",
          "CREATE INDEX IF NOT EXISTS days ON latents (day)")


class LatentStore:
    """When it is full, the least recently used latents are removed.

    It never stops a render: latents that cannot be read or written are computed again. Several processes may share a
    file.
    """

    def __init__(self, file: Path | None = None, limit: int = LIMIT):
        """file: created with its folder when it is missing; None: in memory."""
        self.limit, self._connection = limit, None
        with suppress(ImportError):  # some Pythons are built without it
            import sqlite3
            self._error = sqlite3.Error
            self._connection = _open(sqlite3, file) or _open(sqlite3, None)

    def get(self, keys: Iterable[bytes]) -> dict[bytes, bytes]:
        """The stored values of those keys that have one."""
        values, requested, day = {}, list(dict.fromkeys(keys)), today()
        for i in range(0, len(requested) if self._connection else 0, BATCH):
            batch = requested[i:i + BATCH]
            among = f"WHERE key IN ({','.join('?' * len(batch))})"
            with suppress(self._error), self._connection:
                values |= dict(self._connection.execute(f"SELECT key, value FROM latents {among}", batch))
                self._connection.execute(f"UPDATE latents SET day = ? {among} AND day < ?", [day, *batch, day])
        return values

    def put(self, values: dict[bytes, bytes]) -> None:
        """Store values, and remove the oldest ones if it is full."""
        if not self._connection:
            return
        day = today()
        with suppress(self._error), self._connection:
            self._connection.executemany("INSERT OR REPLACE INTO latents VALUES (?, ?, ?)",
                                         [(key, day, value) for key, value in values.items()])
            self._shrink()

    def bytes(self) -> int:
        """Size of the stored latents."""
        pages, free, size = (self._connection.execute(f"PRAGMA {name}").fetchone()[0]
                             for name in ("page_count", "freelist_count", "page_size"))
        return (pages - free) * size

    def _shrink(self) -> None:
        used = self.bytes()
        if used > self.limit:
            (count,) = self._connection.execute("SELECT COUNT(*) FROM latents").fetchone()
            surplus = max(1, round(count * (1 - REMAINING * self.limit / used)))
            self._connection.execute("DELETE FROM latents WHERE key IN "
                                     "(SELECT key FROM latents ORDER BY day, rowid LIMIT ?)", [surplus])


def files(file: Path) -> list[Path]:
    """A store's file, and those that SQLite leaves beside it while it works."""
    return [file, *(file.with_name(file.name + ending) for ending in ("-journal", "-wal", "-shm"))]


def today() -> int:
    return int(time.time()) // DAY


def _open(sqlite3, file: Path | None):
    """A connection, or None; a damaged file is created anew."""
    for _ in range(2):
        try:
            if file is not None:
                file.parent.mkdir(parents=True, exist_ok=True)
            connection = sqlite3.connect(file or ":memory:", timeout=1.0, check_same_thread=False)
            for statement in SCHEMA:
                connection.execute(statement)
            connection.execute("SELECT COUNT(*) FROM latents")
            return connection
        except sqlite3.OperationalError:  # no permission, no space, or locked: not ours to remove
            return None
        except (sqlite3.DatabaseError, OSError):
            with suppress(sqlite3.Error, UnboundLocalError):
                connection.close()
            with suppress(OSError):
                file.unlink()
    return None
