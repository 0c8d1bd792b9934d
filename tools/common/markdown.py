# SPDX-License-Identifier: GPL-3.0-or-later
"""Tables for documents."""
from __future__ import annotations

import json
from pathlib import Path


def write_table(path: Path, head: list[str], rows: list[list[str]], numbers: object) -> str:
    """Write a table in Markdown, and the numbers behind it as JSON, to files with these suffixes; returns the table.

    Raises OSError as the disk does.
    """
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    table = "".join(f"| {' | '.join(line)} |\n" for line in lines)
    path.with_suffix(".md").write_text(table, encoding="utf-8")
    path.with_suffix(".json").write_text(json.dumps(numbers, indent=1) + "\n", encoding="utf-8")
    return table
