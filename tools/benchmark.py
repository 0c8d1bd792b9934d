# SPDX-License-Identifier: GPL-3.0-or-later
"""Seconds against triangles (512x512) and against resolution (64k triangles), beside Cycles (paper, runtime figures).

    python -m tools.benchmark -o DIR [--triangles 1638,4096,...] [--resolutions 512,...] [--presets rf2_small,rf2_200m]
                              [--cycles-samples N] [--precision P] [--threads N] [--quick]

rf2_small is F12 with the bundled weights: conversion, guides and network. rf2_200m is the forward alone, with random
weights of a fixed seed: pictures mean nothing, the cost is that of the published weights. Cycles' time is extrapolated
from two sample counts (see CYCLES_RULE; --cycles-samples 0 leaves it out). Every point runs in a process of its own and
is written to DIR/benchmark.csv when done; points that are there are not measured again. Then DIR/benchmark.png is drawn
and one line of JSON printed. Exit status 1 when a point failed.
"""
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


def main() -> int:
    arguments = _arguments()
    arguments.output.mkdir(parents=True, exist_ok=True)
    table = arguments.output / "benchmark.csv"
    rows, failed = read(table), []
    for point in points(arguments):
        if key(point) in rows:
            continue
        print(" ".join(map(str, key(point)[:4])), file=sys.stderr, flush=True)
        threads = {"OMP_NUM_THREADS": str(point["threads"])} if point["threads"] else {}
        done = subprocess.run([sys.executable, "-m", "tools.benchmark_point", json.dumps(point)], text=True,
                              cwd=Path(__file__).parent.parent, env=os.environ | threads, capture_output=True)
        if done.returncode or not done.stdout.strip():
            reason = done.stderr.strip().splitlines() or [f"exit status {done.returncode}"]
            failed.append({"point": point, "error": reason[-1]})
            continue
        rows[key(point)] = point | {"precision_asked": point["precision"]} | json.loads(done.stdout.splitlines()[-1])
        append(table, rows[key(point)])
    wanted = [rows[key(point)] for point in points(arguments) if key(point) in rows]
    from .benchmark_report import plot, summary
    plot(wanted, arguments.output / "benchmark.png")
    print(json.dumps(summary(wanted) | {"cycles_rule": CYCLES_RULE, "failed": failed,
                                        "weights": {"rf2_small": "bundled", "rf2_200m": "random, seed 0"},
                                        "output": [str(table), str(arguments.output / "benchmark.png")]}))
    return 1 if failed else 0


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


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tools.benchmark", description=__doc__.splitlines()[0])
    numbers = lambda text: tuple(map(int, text.split(",")))  # noqa: E731
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    parser.add_argument("--triangles", type=numbers, default=TRIANGLES)
    parser.add_argument("--resolutions", type=numbers, default=RESOLUTIONS, help="the smallest is that of --triangles")
    parser.add_argument("--fixed-triangles", type=int, default=65536, help="of the plot against resolution")
    parser.add_argument("--presets", type=lambda text: tuple(text.split(",")), default=SUBJECTS)
    parser.add_argument("--cycles-samples", type=int, default=64, metavar="N")
    parser.add_argument("--precision", choices=("auto", "fp32", "bf16", "fp16"), default="auto")
    parser.add_argument("--threads", type=int, default=0, help="of all programs (default: all cores)")
    parser.add_argument("--quick", action="store_true", help="one small point of everything, to see that it works")
    arguments = parser.parse_args()
    if not set(arguments.presets) <= set(SUBJECTS):
        parser.error(f"--presets knows {', '.join(SUBJECTS)}")
    if arguments.quick:
        arguments.triangles, arguments.resolutions, arguments.fixed_triangles = (512,), (64,), 512
        arguments.cycles_samples = min(arguments.cycles_samples, 1)
    return arguments


if __name__ == "__main__":
    sys.exit(main())
