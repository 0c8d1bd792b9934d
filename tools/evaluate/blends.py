# SPDX-License-Identifier: GPL-3.0-or-later
""".blend files, rendered by both engines."""
from __future__ import annotations

import tempfile
from pathlib import Path

from tools.exr import read_pass
from tools.rendering import render, samples_in_time

from .scores import Evaluation, scores


def evaluate_blend(path: Path, weights: str, folder: Path, threads: int) -> Evaluation:
    """Metrics of one picture against the file's own settings in Cycles; `folder` gets both as multilayer EXR.

    Raises RuntimeError with the engine's message if it cannot be rendered.
    """
    common = ["--threads", threads] if threads else []
    ours, reference = (folder / f"{path.stem}.{engine}.exr" for engine in ("renderformer", "cycles"))
    engine = render(path, ours, "--weights", weights, *common)
    cycles, seconds = render(path, reference, "--engine", "cycles", *common), engine["seconds"]["total"]
    with tempfile.TemporaryDirectory() as scratch:

        def few(samples: int) -> float:
            exr = Path(scratch, f"{samples}.exr")
            return render(path, exr, "--engine", "cycles", "--samples", samples, *common)["seconds"]["total"]

        samples, equal_seconds = samples_in_time(seconds, cycles["samples"], few)
        files = {"ours": ours, "reference": reference, "equal": Path(scratch, f"{samples}.exr")}
        view = {name: read_pass(exr, "Combined", "RGB") for name, exr in files.items()}
    found = scores([view["ours"]], [view["reference"]], triangles=engine["triangles"], seconds=seconds,
                   cycles_seconds=cycles["seconds"]["total"])
    found["beside"] = {"cycles_equal": scores([view["equal"]], [view["reference"]], samples=samples,
                                              seconds=equal_seconds)}
    return Evaluation(found, [view])
