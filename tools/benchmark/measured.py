# SPDX-License-Identifier: GPL-3.0-or-later
"""Points of the benchmark, each in a process of its own."""
from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path


class MeasurementError(Exception):
    """The last line of what a process that failed has said."""


def measured(point: dict) -> dict:
    """A row of the table for what tools.benchmark.point is asked. Raises MeasurementError."""
    threads = {"OMP_NUM_THREADS": str(point["threads"])} if point["threads"] else {}
    done = subprocess.run([sys.executable, "-m", "tools.benchmark.point", json.dumps(point)], text=True,
                          cwd=Path(__file__).parents[2], env=os.environ | threads, capture_output=True)
    if done.returncode or not done.stdout.strip():
        reason = done.stderr.strip().splitlines() or [f"exit status {done.returncode}"]
        raise MeasurementError(reason[-1])
    return point | {"precision_asked": point["precision"]} | json.loads(done.stdout.splitlines()[-1])
