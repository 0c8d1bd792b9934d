# SPDX-License-Identifier: GPL-3.0-or-later
"""Seconds against triangles (512x512) and against resolution (64k triangles), beside Cycles (paper, runtime figures).

    python -m tools.benchmark -o DIR [--triangles 1638,4096,...] [--resolutions 512,...] [--presets rf2_small,rf2_200m]
                              [--cycles-samples N] [--precision P] [--threads N] [--quick]
    python -m tools.benchmark --device auto|cpu|cuda|cuda:1|mps [--precision P]

rf2_small is F12 with the bundled weights: conversion, guides and network. rf2_200m is the forward alone, with random
weights of a fixed seed: pictures mean nothing, the cost is that of the published weights. Cycles' time is extrapolated
from two sample counts (see CYCLES_RULE; --cycles-samples 0 leaves it out). Every point runs in a process of its own and
is written to DIR/benchmark.csv when done; points that are there are not measured again. Then DIR/benchmark.png is drawn
and one line of JSON printed. Exit status 1 when a point failed. --device prints what one device does with the published
network's sizes, in about a minute (device.py): for reports about graphics cards.
"""
from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from renderformer_v2.model.compute.precision import CHOICES
from tools.common.console import numbers

from .points import (
    CYCLES_RULE,
    RESOLUTIONS,
    SUBJECTS,
    TRIANGLES,
    MeasurementError,
    append_row,
    list_points,
    measure_point,
    point_key,
    read_table,
)
from .report import plot, summarize

TABLE = "benchmark.csv"


def main() -> int:
    arguments = parse_arguments()
    if arguments.device:
        from .device import measure as measure_device
        try:
            print(json.dumps(measure_device(arguments.device, arguments.precision)))
        except ValueError as error:
            print(error, file=sys.stderr)
            return 1
        return 0
    arguments.output.mkdir(parents=True, exist_ok=True)
    measured, failed = measure(arguments)
    plot(measured, arguments.output / "benchmark.png")
    print(json.dumps(summarize(measured) | {
        "cycles_rule": CYCLES_RULE, "failed": failed, "weights": {"rf2_small": "bundled", "rf2_200m": "random, seed 0"},
        "output": [str(arguments.output / TABLE), str(arguments.output / "benchmark.png")]}))
    return 1 if failed else 0


def measure(arguments: argparse.Namespace) -> tuple[list[dict], list[dict]]:
    """The rows of all points, those that TABLE in an existing folder has included, and the points that failed."""
    table = arguments.output / TABLE
    rows, failed, keys = read_table(table), [], []
    for point in list_points(arguments):
        key = point_key(point)
        keys.append(key)
        if key in rows:
            continue
        print(" ".join(map(str, key[:4])), file=sys.stderr, flush=True)
        try:
            rows[key] = measure_point(point)
        except MeasurementError as error:
            failed.append({"point": point, "error": str(error)})
            continue
        append_row(table, rows[key])
    return [rows[key] for key in keys if key in rows], failed


def parse_arguments(arguments: list[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tools.benchmark", description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, metavar="DIR")
    parser.add_argument("--device", help="measure this device alone; needs no -o")
    parser.add_argument("--triangles", type=numbers, default=TRIANGLES)
    parser.add_argument("--resolutions", type=numbers, default=RESOLUTIONS, help="the smallest is that of --triangles")
    parser.add_argument("--fixed-triangles", type=int, default=65536, help="of the plot against resolution")
    parser.add_argument("--presets", type=lambda text: tuple(text.split(",")), default=SUBJECTS)
    parser.add_argument("--cycles-samples", type=int, default=64, metavar="N")
    parser.add_argument("--precision", choices=CHOICES, default="auto")
    parser.add_argument("--threads", type=int, default=0, help="of all programs (default: all cores)")
    parser.add_argument("--quick", action="store_true", help="one small point of everything, to see that it works")
    arguments = parser.parse_args(arguments)
    if not (arguments.output or arguments.device):
        parser.error("one of -o and --device is needed")
    if not set(arguments.presets) <= set(SUBJECTS):
        parser.error(f"--presets knows {', '.join(SUBJECTS)}")
    if arguments.quick:
        arguments.triangles, arguments.resolutions, arguments.fixed_triangles = (512,), (64,), 512
        arguments.cycles_samples = min(arguments.cycles_samples, 1)
    return arguments


if __name__ == "__main__":
    sys.exit(main())
