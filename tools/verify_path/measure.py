# SPDX-License-Identifier: GPL-3.0-or-later
"""How near a bundle's pictures of held-out samples are to Cycles', and how near a grey picture would be."""
from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from tools.datagen.sample_files import sample_paths
from tools.evaluate.report import write_page, write_pictures
from tools.evaluate.samples import Renderers, evaluate_sample
from tools.evaluate.scores import compute_means, compute_scores


def measure(samples: Path, bundle: Path, out: Path) -> dict:
    """Means of the metrics, of a grey picture's under "grey"; `out` gets report.json and a page with all pictures."""
    renderers, scenes, pictures = Renderers.of(str(bundle)), {}, {}
    out.mkdir(parents=True, exist_ok=True)
    for path in sample_paths(samples):
        evaluation = evaluate_sample(path, renderers)
        references = [view["reference"] for view in evaluation.views]
        evaluation.scores["beside"]["grey"] = compute_scores([grey(picture) for picture in references], references)
        scenes[path.stem] = evaluation.scores
        pictures[path.stem] = write_pictures(evaluation, out, path.stem)
    report = {"weights": str(bundle), "scenes": scenes, "mean": compute_means(list(scenes.values()))}
    (out / "report.json").write_text(json.dumps(report, indent=1))
    write_page(report, pictures, out / "report.html")
    return report["mean"]


def grey(reference: np.ndarray) -> np.ndarray:
    """A picture (H, W, 3) of one grey, as bright as another."""
    return np.full_like(reference, reference.mean())
