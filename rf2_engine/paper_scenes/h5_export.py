# SPDX-License-Identifier: GPL-3.0-or-later
"""A Blender scene as an H5 scene, with the latents of published weights (docs/scene-input.md 8.1)."""
from __future__ import annotations

from pathlib import Path

import bpy

from ...model.errors import CheckpointError, SceneError
from ...model.scene import RenderScene
from ...model.weights.presets import BUNDLED
from ..convert.camera.camera import convert_camera
from ..convert.data.report import Report
from ..convert.scene import convert
from ..cycles.world import CyclesWorld
from ..progress.status import Status
from ..setup import importing
from .depsgraph import in_render


def export_h5(scene: bpy.types.Scene, weights: str | None, path: Path, report: Report) -> RenderScene:
    """Convert the scene as F12 would, and write it with its camera; weights: folder of the published bundle.

    Raises CheckpointError for the weights, SceneError for the scene, OSError as the disk does.
    """
    if weights in (None, BUNDLED):
        raise CheckpointError("H5 scenes hold latents of the published weights: choose those in Render Properties > "
                              "RenderFormer-V2 > Weights, or give their folder with --weights")
    settings = scene.renderformer_v2

    def converted(engine, depsgraph):
        view = convert_camera(depsgraph, engine.resolution_x, engine.resolution_y, None, report)
        return convert(depsgraph, view, token_budget=settings.token_budget, max_edge=settings.max_edge, report=report,
                       by_cycles=CyclesWorld(engine, depsgraph, Status(engine)), as_is=settings.as_is,
                       paper_lamps=settings.paper_lamps), view

    found, view = in_render(scene, converted)
    if not len(found):
        holds = "only volumes" if found.volumes else "nothing to render"
        raise SceneError(f'scene "{scene.name}" holds {holds}: an H5 scene needs at least one triangle, '
                         "add a mesh or a lamp")
    importing.import_packages()
    from ...model.published.h5 import write_h5
    from ...model.published.pipeline import PublishedPipeline
    write_h5(path, PublishedPipeline(weights, "cpu", None).process(found, [view]))
    return found
