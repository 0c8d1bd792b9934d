# SPDX-License-Identifier: GPL-3.0-or-later
""".blend files, rendered by both engines."""
from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

from tools.common.pictures import read_pass
from tools.common.render_process import find_samples_in_time, run_render, run_render_cached

from .scores import Evaluation, compute_scores

OTHER_LIGHT = {"network_and_rays": "NETWORK", "transformer_alone": "TRANSFORMER"}  # choices of Light


def evaluate_blend(path: Path, weights: str, folder: Path, threads: int, cycles: Sequence[int] = (),
                   reference: int | None = None) -> Evaluation:
    """Metrics of one picture against Cycles; `folder` gets both as multilayer EXR, and keeps the reference.

    reference: samples of the reference, which then has no Clamp Indirect; None for the file's settings. cycles: samples
    of Cycles' pictures that are also compared; none for as many as take about the engine's time.
    Raises RuntimeError with the engine's message if it cannot be rendered.
    """
    common = ["--threads", threads] if threads else []
    ours, exact = (folder / f"{path.stem}.{engine}.exr" for engine in ("renderformer", "cycles"))
    own_run = run_render(path, ours, "--weights", weights, *common)
    seconds = own_run["seconds"]["total"]
    reference_run = run_render_cached(path, exact, "--engine", "cycles",
                                      *(["--samples", reference, "--unclamped"] if reference else []), *common)
    with tempfile.TemporaryDirectory() as scratch:
        other, other_seconds = {}, {}
        for name, light in OTHER_LIGHT.items():
            other[name] = Path(scratch, f"{name}.exr")
            run = run_render(path, other[name], "--light", light, "--weights", weights, *common)
            other_seconds[name] = run["seconds"]["total"]

        def time_cycles(samples: int) -> float:
            exr = Path(scratch, f"{samples}.exr")
            return run_render(path, exr, "--engine", "cycles", "--samples", samples, *common)["seconds"]["total"]

        if cycles:
            timings = {f"cycles_{samples}": (samples, time_cycles(samples)) for samples in cycles}
        else:
            timings = {"cycles_equal": find_samples_in_time(seconds, reference_run["samples"], time_cycles)}
        files = {"ours": ours, "reference": exact} | other
        files |= {name: Path(scratch, f"{samples}.exr") for name, (samples, _) in timings.items()}
        pictures = {name: read_pass(exr, "Combined", "RGB") for name, exr in files.items()}

    def score(name: str, **more: float) -> dict[str, float]:
        return compute_scores([pictures[name]], [pictures["reference"]], **more)

    scores = score("ours", triangles=own_run["triangles"], seconds=seconds,
                   cycles_seconds=reference_run["seconds"]["total"])
    scores["beside"] = {name: score(name, samples=samples, seconds=own_seconds)
                        for name, (samples, own_seconds) in timings.items()}
    scores["beside"] |= {name: score(name, seconds=own_seconds) for name, own_seconds in other_seconds.items()}
    closest = min(timings, key=lambda name: abs(timings[name][1] - seconds))
    return Evaluation(scores, [{"ours": pictures["ours"], "reference": pictures["reference"],
                                "equal": pictures[closest]}])
