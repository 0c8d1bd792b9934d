# SPDX-License-Identifier: GPL-3.0-or-later
"""Seconds by triangles and by pixels, as tools.benchmark measures them, with the paper's curves."""
from __future__ import annotations

from tools.benchmark import __main__ as benchmark
from tools.benchmark.report import collect_seconds, plot
from tools.common.markdown import write_table

# The paper's figures, one A100; Cycles with up to 4096 samples
TRIANGLES = 1597, 2557, 6397, 12277, 21757, 63277, 83197, 127233  # at 512 x 512
RESOLUTIONS = 512, 768, 1024, 1536, 2048, 3072, 4096              # with 64k triangles
PAPER = {
    "RF-V2": ((0.0468, 0.0502, 0.0687, 0.1118, 0.18, 0.5382, 0.6821, 1.1212),
              (0.525, 0.791, 1.226, 2.325, 3.917, 8.500, 14.915)),
    "RF-V1": ((0.056921, 0.060798, 0.081398, 0.142014, 0.258925, 1.198455, 1.88105, 3.922935),
              (1.307, 1.618, 2.196, 4.076, 7.775, 24.821, 65.056)),
    "Cycles": ((3.634, 3.762, 4.002, 4.238, 4.374, 4.857, 4.954, 5.248),
               (5.13, 9.41, 15.07, 31.11, 53.75, 127.30, 216.80)),
}


def main(arguments: list[str]) -> None:
    """Raises RuntimeError when a point could not be measured, after the others were."""
    options = benchmark.parse_arguments(arguments)
    options.output.mkdir(parents=True, exist_ok=True)
    rows, failed = benchmark.measure(options)
    fixed = options.fixed_triangles
    plot(rows, options.output / "runtime.png", {
        f"{name} (paper, A100)": dict(zip([(n, 512) for n in TRIANGLES], by_triangles))
        | dict(zip([(fixed, r) for r in RESOLUTIONS], by_pixels)) for name, (by_triangles, by_pixels) in PAPER.items()})
    ours = collect_seconds(rows)
    sizes = sorted({size for seconds in ours.values() for size in seconds})
    lines = [[f"{n}, {r}", *(f"{ours[name][n, r]:.2f} s" if (n, r) in ours[name] else "" for name in ours)]
             for n, r in sizes]
    print(write_table(options.output / "runtime", ["triangles, pixels", *ours], lines,
                      {"measured": rows, "paper": PAPER, "failed": failed}), end="")
    if failed:
        raise RuntimeError(f"{len(failed)} points could not be measured: {failed[0]['error']}")
