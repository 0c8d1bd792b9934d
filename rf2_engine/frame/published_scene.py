# SPDX-License-Identifier: GPL-3.0-or-later
"""Adapt a scene to published weights, and report what in it they were not trained for."""
from __future__ import annotations

from pathlib import Path

from ...model.normalize import Normalization
from ...model.published.as_trained import TRIANGLES, WELL_KNOWN, as_trained, describe_untrained, find_emitters
from ...model.published.bundle_files import bundle_and_transformer, choose_transformer
from ...model.scene import RenderScene, View
from ..convert.data.report import Report
from ..frame_settings import FrameSettings, Network

NAME = "Published Weights"
FULL = 0.9  # of Max Triangles, from which on there may be too few


def network_input(scene: RenderScene, view: View, settings: FrameSettings, report: Report) -> RenderScene:
    """The input scene of the network: in network units for published weights, unchanged for others.

    Reports how it differs from the scenes that published weights were trained with.
    """
    if settings.network is not Network.PUBLISHED:
        return scene
    bundle, chosen = bundle_and_transformer(Path(settings.weights), settings.transformer)
    best = choose_transformer(Path(), view.longer_side, chosen)
    available = choose_transformer(bundle, view.longer_side, chosen)
    if best != available:
        report.approximated(NAME, f"{best} was trained for pictures of this size, but {bundle} has only {available}")
    normalized = Normalization.of(scene).scene(scene)
    tokens = as_trained(normalized, find_emitters(normalized))
    has_few = settings.token_budget < WELL_KNOWN and not settings.as_is
    if has_few and FULL * settings.token_budget <= len(scene):
        report.approximated(NAME, f"the scene fills Max Triangles ({settings.token_budget}): the weights know "
                                  f"{WELL_KNOWN} well, and up to {TRIANGLES}, which show more and take longer")
    for remark in describe_untrained(tokens):
        report.approximated(NAME, remark)
    return tokens
