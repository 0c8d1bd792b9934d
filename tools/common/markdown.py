# SPDX-License-Identifier: GPL-3.0-or-later
"""Tables for documents."""
from __future__ import annotations

import json
from pathlib import Path


def write_table(path: Path, head: list[str], rows: list[list[str]], numbers: object) -> None:
    """Write path.md, a table, and path.json with the numbers behind it. Raises OSError as the disk does."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    path.with_suffix(".md").write_text("".join(f"| {' | '.join(line)} |\n" for line in lines), encoding="utf-8")
    path.with_suffix(".json").write_text(json.dumps(numbers, indent=1) + "\n", encoding="utf-8")
