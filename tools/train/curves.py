# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m tools.train.curves LOG.jsonl [...] -o OUT.png: how the losses went, each point the mean of some steps.

Several logs are the parts of one run; where they overlap, the later one counts.
"""
from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from tools.common.pictures import write_atomically

LOSSES = {"image": "picture", "direct": "direct light of the lobes", "indirect": "indirect light of the lobes"}
SMOOTH = 7  # points of the median that is drawn over them


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.train.curves", description=__doc__)
    parser.add_argument("logs", type=Path, nargs="+", metavar="LOG.jsonl")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT.png")
    options = parser.parse_args()
    try:
        draw(points(options.logs), options.output.resolve())
    except (OSError, ValueError) as error:
        print(error, file=sys.stderr)
        return 1
    return 0


def points(logs: list[Path]) -> list[dict]:
    """The lines of all logs by step. Raises OSError, and ValueError naming a file that is no such log."""
    entries: dict[int, dict] = {}
    for log in logs:
        try:
            lines = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]
            begin = min(line["step"] for line in lines)
        except (ValueError, KeyError, TypeError) as error:
            raise ValueError(f"{log} is no log of tools.train.network: choose log.jsonl of its --out") from error
        earlier = {step: line for step, line in entries.items() if step < begin}
        entries = earlier | {line["step"]: line for line in lines}
    return [entries[step] for step in sorted(entries)]


def draw(lines: list[dict], path: Path) -> None:
    """Write the PNG. Raises OSError naming `path`."""
    import matplotlib
    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(7, 3), dpi=110, layout="constrained")
    steps = [line["step"] for line in lines]
    for key, name in LOSSES.items():
        values = np.array([line[key] for line in lines])
        curve = [np.median(values[max(i - SMOOTH // 2, 0):i + SMOOTH // 2 + 1]) for i in range(len(values))]
        color = axes.plot(steps, curve, label=name)[0].get_color()
        axes.plot(steps, values, ".", color=color, alpha=0.35, markersize=3)
    axes.set(xlabel="step", ylabel="loss", yscale="log")
    axes.legend(fontsize=8)
    try:
        write_atomically(path, figure.savefig)
    finally:
        pyplot.close(figure)


if __name__ == "__main__":
    sys.exit(main())
