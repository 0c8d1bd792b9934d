# SPDX-License-Identifier: GPL-3.0-or-later
"""The points that are measured, and the table of results."""
from __future__ import annotations

import argparse
import csv
import json
import os
import subprocess
import sys
from pathlib import Path

SUBJECTS = ("rf2_small", "rf2_200m")
TRIANGLES = (1638, 4096, 8192, 16384, 32768, 65536, 131072)
RESOLUTIONS = (512, 1024, 2048, 4096)
CYCLES_SAMPLES = 4096  # the paper's
CYCLES_RULE = ("Cycles renders with two sample counts a < b, adaptive sampling and denoising off; per sample = "
               "(t_b - t_a) / (b - a), fixed = t_a - a * per sample, seconds = fixed + "
               f"{CYCLES_SAMPLES} * per sample. Adaptive sampling, as in the paper, may stop earlier. b is "
               "--cycles-samples at 512x512 and falls with the number of pixels, a is a quarter of b")
KEY = ("subject", "triangles", "resolution", "samples", "precision_asked", "threads")
FIELDS = KEY + ("seconds", "stage1_seconds", "stage2_seconds", "real_triangles", "tokens", "precision", "device",
                "flops", "stage1_flops", "product_flops_per_s", "efficiency", "peak_bytes")


def points(arguments: argparse.Namespace) -> list[dict]:
    """All measurements that both plots need, cheap ones first, each once."""
    sizes = [(n, min(arguments.resolutions)) for n in arguments.triangles]
    sizes += [(arguments.fixed_triangles, r) for r in arguments.resolutions]
    found = []
    for triangles, resolution in sorted(dict.fromkeys(sizes), key=lambda size: size[0] * size[1] ** 2):
        most = max(2, round(arguments.cycles_samples * (512 / resolution) ** 2))
        cycles = [("cycles", s) for s in (max(1, most // 4), most)] if arguments.cycles_samples else []
        for subject, samples in [(preset, 0) for preset in arguments.presets] + cycles:
            found.append({"subject": subject, "triangles": triangles, "resolution": resolution, "samples": samples,
                          "precision": arguments.precision, "threads": arguments.threads})
    return found


def key(point: dict) -> tuple:
    """What makes a measurement; the precision asked for does not concern Cycles."""
    precision = "" if point["subject"] == "cycles" else point.get("precision_asked", point["precision"])
    return (point["subject"], int(point["triangles"]), int(point["resolution"]), int(point["samples"]), precision,
            int(point["threads"]))


def read(table: Path) -> dict[tuple, dict]:
    """Rows by `key`, numbers as numbers; none where there is no file."""
    if not table.exists():
        return {}
    with open(table, newline="") as file:
        rows = [{name: _number(text) for name, text in row.items()} for row in csv.DictReader(file)]
    return {key(row): row for row in rows}


def append(table: Path, row: dict) -> None:
    new = not table.exists()
    with open(table, "a", newline="") as file:
        writer = csv.DictWriter(file, FIELDS, extrasaction="ignore", restval="")
        if new:
            writer.writeheader()
        writer.writerow(row)


def _number(text: str):
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


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
