# SPDX-License-Identifier: GPL-3.0-or-later
"""The points that are measured, each in a process of its own, and the table of results."""
from __future__ import annotations

import argparse
import csv
import json
import os
import subprocess
import sys
from pathlib import Path

from tools.extension import ROOT

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


class MeasurementError(Exception):
    """The message is the last line of a process that failed."""


def list_points(arguments: argparse.Namespace) -> list[dict]:
    """All measurements that both plots need, cheap ones first, each once."""
    sizes = [(n, min(arguments.resolutions)) for n in arguments.triangles]
    sizes += [(arguments.fixed_triangles, r) for r in arguments.resolutions]
    listed = []
    for triangles, resolution in sorted(dict.fromkeys(sizes), key=lambda size: size[0] * size[1] ** 2):
        most = max(2, round(arguments.cycles_samples * (512 / resolution) ** 2))
        cycles = [("cycles", s) for s in (max(1, most // 4), most)] if arguments.cycles_samples else []
        for subject, samples in [(preset, 0) for preset in arguments.presets] + cycles:
            listed.append({"subject": subject, "triangles": triangles, "resolution": resolution, "samples": samples,
                           "precision": arguments.precision, "threads": arguments.threads})
    return listed


def point_key(point: dict) -> tuple:
    """What identifies a measurement; Cycles has no precision."""
    precision = "" if point["subject"] == "cycles" else point.get("precision_asked", point["precision"])
    return (point["subject"], int(point["triangles"]), int(point["resolution"]), int(point["samples"]), precision,
            int(point["threads"]))


def read_table(table: Path) -> dict[tuple, dict]:
    """Rows by `point_key`, numbers as numbers; none where there is no file."""
    if not table.exists():
        return {}
    with open(table, newline="") as file:
        rows = [{name: _parse_number(text) for name, text in row.items()} for row in csv.DictReader(file)]
    return {point_key(row): row for row in rows}


def append_row(table: Path, row: dict) -> None:
    new = not table.exists()
    with open(table, "a", newline="") as file:
        writer = csv.DictWriter(file, FIELDS, extrasaction="ignore", restval="")
        if new:
            writer.writeheader()
        writer.writerow(row)


def measure_point(point: dict) -> dict:
    """A row of the table, by tools.benchmark.point in another process. Raises MeasurementError."""
    threads = {"OMP_NUM_THREADS": str(point["threads"])} if point["threads"] else {}
    finished = subprocess.run([sys.executable, "-m", "tools.benchmark.point", json.dumps(point)], text=True,
                              cwd=ROOT, env=os.environ | threads, capture_output=True)
    if finished.returncode or not finished.stdout.strip():
        reason = finished.stderr.strip().splitlines() or [f"exit status {finished.returncode}"]
        raise MeasurementError(reason[-1])
    return point | {"precision_asked": point["precision"]} | json.loads(finished.stdout.splitlines()[-1])


def _parse_number(text: str):
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text
