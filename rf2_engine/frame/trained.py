# SPDX-License-Identifier: GPL-3.0-or-later
"""What published weights are told of a scene, and what of it they were not trained for."""
from __future__ import annotations

from pathlib import Path

from ...model.normalize import Normalization
from ...model.published.as_trained import TRIANGLES, WELL_KNOWN, as_trained, emitters, remarks
from ...model.published.bundle_files import bundle_and_transformer, transformer_for
from ...model.scene import RenderScene, View
from ..convert.data.report import Report
from ..settings import FrameSettings

NAME = "Published Weights"
FULL = 0.9  # of Max Triangles, from which on there may be too few


def told(scene: RenderScene, view: View, settings: FrameSettings, report: Report) -> RenderScene:
    """The scene as its weights are told it, published ones in network units; reported is what is unlike training."""
    if settings.guided:
        return scene
    bundle, chosen = bundle_and_transformer(Path(settings.weights), settings.transformer)
    wanted, found = (transformer_for(folder, view.longer_side, chosen) for folder in (Path(), bundle))
    if wanted != found:
        report.approximated(NAME, f"{wanted} was trained for pictures of this size, but {bundle} has only {found}")
    normalized = Normalization.of(scene).scene(scene)
    tokens = as_trained(normalized, emitters(normalized))
    few = settings.token_budget < WELL_KNOWN and not settings.as_is
    if few and FULL * settings.token_budget <= len(scene):
        report.approximated(NAME, f"the scene fills Max Triangles ({settings.token_budget}): the weights know "
                                  f"{WELL_KNOWN} well, and up to {TRIANGLES}, which show "
                                  "more and take longer")
    for remark in remarks(tokens):
        report.approximated(NAME, remark)
    return tokens
