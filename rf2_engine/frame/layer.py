# SPDX-License-Identifier: GPL-3.0-or-later
"""A view layer that is rendered: what is known of it, its camera and its scene."""
from __future__ import annotations

from contextlib import nullcontext
from dataclasses import dataclass

import bpy

from ...model import progress
from ...model.scene import RenderScene, View
from .. import passes as pass_table
from ..convert.camera.camera import convert_camera
from ..convert.report import Report
from ..convert.scene import convert
from ..cycles.bake import Baker
from ..cycles.world import CyclesWorld
from ..progress.plan import Plan
from ..progress.status import Status
from ..settings import FrameSettings
from . import checks, rectangle, shot, shutter
from .limits import report_limits
from .optics import Optics
from .rectangle import Border
from .work import layers, work


@dataclass
class Layer:
    engine: bpy.types.RenderEngine
    depsgraph: bpy.types.Depsgraph
    name: str
    settings: FrameSettings
    optics: Optics
    border: Border | None
    lit: bool  # whether the light of each lobe is wanted
    plan: Plan
    status: Status
    report: Report

    @classmethod
    def of(cls, engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, optics: Optics, status: Status,
           report: Report) -> Layer:
        """Raises SceneError and CheckpointError for what cannot be rendered."""
        scene, layer = depsgraph.scene_eval, depsgraph.view_layer_eval
        settings = FrameSettings.of(scene, layer)
        lit = pass_table.asked_light(layer, settings.light_passes)
        checks.check(depsgraph, settings, report)
        report_limits(depsgraph, report)
        optics = optics.possible(settings.light, depsgraph, report)
        width, height = engine.resolution_x, engine.resolution_y
        border = rectangle.border(width, height, scene.render)
        plan = Plan(work(width, height, border, settings, optics, lit), settings.setup, layers(scene))
        return cls(engine, depsgraph, layer.name, settings, optics, border, lit, plan, status, report)

    def view(self) -> View:
        """From the middle of the lens."""
        return convert_camera(self.depsgraph, self.engine.resolution_x, self.engine.resolution_y, self.border,
                              self.report)

    def scene(self) -> RenderScene:
        first = shot.begins_at(self.engine, self.depsgraph)
        if first is None:
            return self._converted(self.report)
        # This frame is rendered apart from those before it: fit it as the first one of its shot is.
        with progress.part(0.0, 0.5), shutter.clock(self.engine, self.depsgraph) as move_to:
            move_to(first)
            self._converted(Report())
        with progress.part(0.5, 1.0):
            return self._converted(self.report)

    def _converted(self, report: Report) -> RenderScene:
        whole = convert_camera(self.depsgraph, self.engine.resolution_x, self.engine.resolution_y, None)
        with Baker(self.depsgraph) if self.settings.bake_unknown else nullcontext() as baker:
            return convert(self.depsgraph, whole, token_budget=self.settings.token_budget,
                           max_edge=self.settings.max_edge, report=report, steady=shot.steady(self.depsgraph),
                           by_cycles=CyclesWorld(self.engine, self.depsgraph, self.status), baker=baker)
