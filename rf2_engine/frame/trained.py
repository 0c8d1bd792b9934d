# SPDX-License-Identifier: GPL-3.0-or-later
"""What published weights are told of a scene, and what of it they were not trained for."""
from __future__ import annotations

from ...model.normalize import Normalization
from ...model.published import training_range
from ...model.published.as_trained import as_trained, emitters
from ...model.scene import RenderScene
from ..convert.report import Report
from ..settings import FrameSettings

NAME = "Published Weights"


def told(scene: RenderScene, settings: FrameSettings, report: Report) -> RenderScene:
    """The scene as its weights are told it, published ones in network units; reported is what is unlike training."""
    if settings.guided:
        return scene
    normalized = Normalization.of(scene).scene(scene)
    tokens = as_trained(normalized, emitters(normalized))
    for remark in training_range.remarks(tokens):
        report.approximated(NAME, remark)
    return tokens
