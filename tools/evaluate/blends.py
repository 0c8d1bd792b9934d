# SPDX-License-Identifier: GPL-3.0-or-later
""".blend files, rendered by both engines."""
from __future__ import annotations

from pathlib import Path

from tools.exr import read_pass
from tools.rendering import render, samples_in_time

from .scores import Evaluation, scores


def evaluate_blend(path: Path, weights: str, folder: Path, threads: int) -> Evaluation:
    """Metrics of one picture against the file's own settings in Cycles; `folder` gets both and Cycles at equal time.

    Raises RuntimeError with the engine's message if it cannot be rendered.
    """
    common = ["--threads", threads] if threads else []

    def file(name: str) -> Path:
        return folder / f"{path.stem}.{name}.exr"

    def cycles(name: str, *options) -> dict:
        return render(path, file(name), "--engine", "cycles", *options, *common)

    engine = render(path, file("renderformer"), "--weights", weights, *common)
    reference, seconds = cycles("cycles"), engine["seconds"]["total"]
    samples, equal_seconds = samples_in_time(
        seconds, reference["samples"], lambda n: cycles(f"cycles-{n}", "--samples", n)["seconds"]["total"])
    files = {"ours": file("renderformer"), "reference": file("cycles"), "equal": file(f"cycles-{samples}")}
    view = {name: read_pass(exr, "Combined", "RGB") for name, exr in files.items()}
    found = scores([view["ours"]], [view["reference"]], triangles=engine["triangles"], seconds=seconds,
                   cycles_seconds=reference["seconds"]["total"])
    found["beside"] = {"cycles_equal": scores([view["equal"]], [view["reference"]], samples=samples,
                                              seconds=equal_seconds)}
    return Evaluation(found, [view])
