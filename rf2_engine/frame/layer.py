# SPDX-License-Identifier: GPL-3.0-or-later
"""A view layer that is rendered: its settings, camera, scene and stages."""
from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass

import bpy

from ...model import progress
from ...model.scene import RenderScene, View
from .. import passes as pass_table
from ..convert.camera.camera import convert_camera
from ..convert.camera.eyes import Eye, count_views, eyes, view_names
from ..convert.data.report import Report
from ..convert.fitting.framing import Framing
from ..convert.scene import convert, fitted
from ..cycles.bake import Baker
from ..cycles.world import CyclesWorld
from ..progress.plan import Plan
from ..progress.status import Status
from ..render_size import Border, render_border
from ..settings import FrameSettings
from . import checks, shutter
from .limits import report_limits
from .optics import Optics
from .shot import Shot
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
    framing: Framing | None = None  # once the scene was converted
    device: str = ""                # that the network works on, once it is loaded

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
        border = render_border(width, height, scene.render)
        status.views = view_names(engine)
        plan = Plan(work(width, height, border, settings, optics, lit, count_views(scene)), settings.setup,
                    layers(scene))
        return cls(engine, depsgraph, layer.name, settings, optics, border, lit, plan, status, report)

    def eyes(self) -> list[Eye]:
        """At the moment that is evaluated."""
        return eyes(self.engine, self.depsgraph)

    def views(self) -> dict[str, View]:
        """From the middle of the lens of each eye, by the name of the eye's view."""
        return {eye.view: convert_camera(self.depsgraph, self.engine.resolution_x, self.engine.resolution_y,
                                         self.border, self.report, eye) for eye in self.eyes()}

    def scene(self) -> RenderScene:
        """What a shutter sees at other moments of the frame is fitted as the frame is."""
        if self.framing is not None:
            return self._converted(lambda own: self.framing)
        shot = Shot.of(self.depsgraph, self.settings, self.engine.resolution_x, self.engine.resolution_y)
        unknown = shot.unknown()
        begin = len(unknown) / (len(unknown) + 1)
        if unknown:
            with progress.part(0.0, begin), shutter.clock(self.engine, self.depsgraph) as move_to:
                shot.look_ahead(unknown, move_to, self._fitted)

        def steady(own: Framing) -> Framing:
            self.framing = shot.settled(own)
            return self.framing
        with progress.part(begin, 1.0):
            scene = self._converted(steady)
        shot.remember()
        return scene

    def _converted(self, steady: Callable[[Framing], Framing]) -> RenderScene:
        with Baker(self.depsgraph) if self.settings.bake_unknown else nullcontext() as baker:
            return convert(self.depsgraph, self._whole(), token_budget=self.settings.token_budget,
                           max_edge=self.settings.max_edge, report=self.report, steady=steady,
                           by_cycles=CyclesWorld(self.engine, self.depsgraph, self.status), baker=baker,
                           as_is=self.settings.as_is, paper_lamps=self.settings.paper_lamps)

    def _fitted(self) -> Framing:
        return fitted(self.depsgraph, self._whole(), token_budget=self.settings.token_budget,
                      max_edge=self.settings.max_edge,
                      by_cycles=CyclesWorld(self.engine, self.depsgraph, self.status), as_is=self.settings.as_is)

    def _whole(self) -> View:
        return convert_camera(self.depsgraph, self.engine.resolution_x, self.engine.resolution_y, None)
