# SPDX-License-Identifier: GPL-3.0-or-later
""".blend files, rendered by both engines."""
from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

from tools.common.pictures import read_pass
from tools.common.render_process import render, render_once, samples_in_time

from .scores import Evaluation, scores


def evaluate_blend(path: Path, weights: str, folder: Path, threads: int, cycles: Sequence[int] = (),
                   reference: int | None = None) -> Evaluation:
    """Metrics of one picture against Cycles; `folder` gets both as multilayer EXR, and keeps the reference.

    reference: samples of what all are compared with, whose bounced light is not clamped then; the file's own settings
    without. cycles: samples of Cycles' pictures that are set beside; as many as take about the engine's time without.
    Raises RuntimeError with the engine's message if it cannot be rendered.
    """
    common = ["--threads", threads] if threads else []
    ours, exact = (folder / f"{path.stem}.{engine}.exr" for engine in ("renderformer", "cycles"))
    engine = render(path, ours, "--weights", weights, *common)
    seconds = engine["seconds"]["total"]
    whole = render_once(path, exact, "--engine", "cycles",
                        *(["--samples", reference, "--unclamped"] if reference else []), *common)
    with tempfile.TemporaryDirectory() as scratch:
        alone = Path(scratch, "alone.exr")
        alone_seconds = render(path, alone, "--alone", "--weights", weights, *common)["seconds"]["total"]

        def few(samples: int) -> float:
            exr = Path(scratch, f"{samples}.exr")
            return render(path, exr, "--engine", "cycles", "--samples", samples, *common)["seconds"]["total"]

        if cycles:
            took = {f"cycles_{samples}": (samples, few(samples)) for samples in cycles}
        else:
            took = {"cycles_equal": samples_in_time(seconds, whole["samples"], few)}
        pictures = {"ours": ours, "reference": exact, "network_alone": alone}
        pictures |= {name: Path(scratch, f"{samples}.exr") for name, (samples, _) in took.items()}
        view = {name: read_pass(exr, "Combined", "RGB") for name, exr in pictures.items()}
    found = scores([view["ours"]], [view["reference"]], triangles=engine["triangles"], seconds=seconds,
                   cycles_seconds=whole["seconds"]["total"])
    found["beside"] = {name: scores([view[name]], [view["reference"]], samples=samples, seconds=taken)
                       for name, (samples, taken) in took.items()}
    found["beside"]["network_alone"] = scores([view["network_alone"]], [view["reference"]], seconds=alone_seconds)
    closest = min(took, key=lambda name: abs(took[name][1] - seconds))
    return Evaluation(found, [{"ours": view["ours"], "reference": view["reference"], "equal": view[closest]}])
