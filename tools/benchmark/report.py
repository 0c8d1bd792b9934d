# SPDX-License-Identifier: GPL-3.0-or-later
"""From the benchmark's rows to ratios and the paper's two plots."""
from __future__ import annotations

from pathlib import Path

from .points import CYCLES_SAMPLES

LABELS = {"rf2_200m": "RF-V2, 208 M parameters (network)", "rf2_small": "rf2_small (F12)",
          "cycles": f"Cycles, {CYCLES_SAMPLES} samples (extrapolated)"}


def collect_seconds(rows: list[dict]) -> dict[str, dict[tuple[int, int], float]]:
    """Subject -> (triangles, resolution) -> seconds of a frame; Cycles where both sample counts are there."""
    networks: dict[str, dict] = {}
    pairs: dict[tuple[int, int], dict[int, float]] = {}
    for row in rows:
        size = row["triangles"], row["resolution"]
        if row["subject"] == "cycles":
            pairs.setdefault(size, {})[row["samples"]] = row["seconds"]
        else:
            networks.setdefault(row["subject"], {})[size] = row["seconds"]
    cycles = {size: extrapolate_cycles(times) for size, times in pairs.items() if len(times) > 1}
    return networks | ({"cycles": cycles} if cycles else {})


def extrapolate_cycles(times: dict[int, float]) -> float:
    """Sample count -> seconds, two of them, to seconds of CYCLES_SAMPLES (CYCLES_RULE)."""
    few, many = min(times), max(times)
    per_sample = max(times[many] - times[few], 0.0) / (many - few)
    return max(times[few] - few * per_sample, 0.0) + CYCLES_SAMPLES * per_sample


def summarize(rows: list[dict]) -> dict:
    """Ratios to Cycles, efficiency of every network point, and the cost of stage 1 at twice 65,536 triangles."""
    seconds_by_subject = collect_seconds(rows)
    cycles = seconds_by_subject.get("cycles", {})
    ratios = [{"preset": subject, "triangles": size[0], "resolution": size[1], "seconds": seconds,
               "cycles_seconds": cycles[size], "ratio": cycles[size] / seconds}
              for subject, sizes in seconds_by_subject.items() if subject != "cycles"
              for size, seconds in sizes.items() if size in cycles]
    networks = [row for row in rows if row["subject"] != "cycles"]
    efficiency = [{name: row[name] for name in ("subject", "triangles", "resolution", "precision", "seconds", "flops",
                                                "product_flops_per_s", "efficiency", "peak_bytes")} for row in networks]
    return {"ratios": ratios, "networks": efficiency, "stage1_ratio": compute_stage1_ratio(rows)}


def compute_stage1_ratio(rows: list[dict]) -> dict | None:
    """rf2_200m at 131,072 against 65,536 triangles: measured seconds and FLOPs; None without both points."""
    stage1 = {row["triangles"]: row for row in rows
              if row["subject"] == "rf2_200m" and row["triangles"] in (65536, 131072)}
    if len(stage1) < 2:
        return None
    return {name: stage1[131072][name] / stage1[65536][name] for name in ("stage1_seconds", "stage1_flops")}


def plot(rows: list[dict], path: Path, others: dict[str, dict[tuple[int, int], float]] | None = None) -> None:
    """Both plots side by side, as PNG. others: of other machines, seconds by (triangles, resolution) by label."""
    import matplotlib
    matplotlib.use("Agg")
    from matplotlib import pyplot
    seconds_by_subject = collect_seconds(rows) | (others or {})
    smallest = min((row["resolution"] for row in rows), default=0)
    larger = [row["triangles"] for row in rows if row["resolution"] > smallest]
    fixed = max(larger or [row["triangles"] for row in rows], default=0)
    figure, axes = pyplot.subplots(1, 2, figsize=(10, 4), layout="constrained")
    for subject, sizes in seconds_by_subject.items():
        by_triangles = sorted((n, s) for (n, r), s in sizes.items() if r == smallest)
        for axis, points in zip(axes, (by_triangles, sorted((r, s) for (n, r), s in sizes.items() if n == fixed))):
            style = {"marker": "o"} if subject in LABELS else {"marker": ".", "linestyle": ":"}
            axis.plot([x for x, _ in points], [y for _, y in points], label=LABELS.get(subject, subject), **style)
    axes[0].set(xlabel="triangles", title=f"{smallest} x {smallest} pixels")
    axes[1].set(xlabel="resolution (N x N)", title=f"{fixed} triangles")
    for axis in axes:
        axis.set(ylabel="seconds per frame", yscale="log", xscale="log")
        ticks = sorted({float(x) for line in axis.lines if line.get_marker() == "o" for x in line.get_xdata()})
        axis.set_xticks(ticks, [f"{x:.0f}" for x in ticks], rotation=45)
        axis.minorticks_off()
        axis.grid(True, alpha=0.3)
    if seconds_by_subject:
        axes[0].legend(fontsize="small")
    figure.savefig(path, dpi=120)
    pyplot.close(figure)
