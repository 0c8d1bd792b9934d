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
from ..convert.camera.eyes import Eye, eyes, view_names
from ..convert.copying.cache import CopyCache
from ..convert.data.report import Report
from ..convert.fitting.framing import Framing
from ..convert.scene import convert, find_framing
from ..cycles.bake import Baker
from ..cycles.world import CyclesWorld
from ..frame_settings import FrameSettings
from ..progress.plan import Plan
from ..progress.status import Status
from ..render_size import Border, render_border
from . import checks, shutter
from .optics import Optics
from .shot import Shot
from .work import Pictures, count_layers, stage_work


@dataclass(frozen=True)
class Layer:
    """What is known of a view layer before anything is rendered, and what every step needs."""

    engine: bpy.types.RenderEngine
    depsgraph: bpy.types.Depsgraph
    name: str
    settings: FrameSettings
    optics: Optics
    border: Border | None
    with_lobes: bool  # the light of each lobe is requested
    light_groups: list[pass_table.Pass]
    plan: Plan
    status: Status
    report: Report

    @classmethod
    def read(cls, engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, optics: Optics, status: Status,
             report: Report) -> Layer:
        """Raises SceneError and CheckpointError for what cannot be rendered."""
        scene, layer = depsgraph.scene_eval, depsgraph.view_layer_eval
        settings = FrameSettings.read(scene, layer)
        checks.check(depsgraph, settings, report)
        optics = optics.possible(settings.light, depsgraph, report)
        width, height = engine.resolution_x, engine.resolution_y
        status.views = view_names(engine)
        pictures = Pictures.read(depsgraph, settings, width, height)
        plan = Plan(stage_work(pictures, settings, optics), settings.setup, count_layers(scene))
        groups = pass_table.light_groups(layer, settings.light_passes)
        return cls(engine, depsgraph, layer.name, settings, optics, render_border(width, height, scene.render),
                   pictures.with_lobes, groups, plan, status, report)

    @property
    def corner(self) -> tuple[int, int]:
        """Left and bottom of the render border in the frame, in pixels."""
        return self.border[::2] if self.border else (0, 0)

    def eyes(self) -> list[Eye]:
        """The eyes at the moment that is evaluated."""
        return eyes(self.engine, self.depsgraph)

    def views(self) -> dict[str, View]:
        """The view from the middle of each eye's lens, by the name of the eye's view."""
        return {eye.view: convert_camera(self.depsgraph, self.engine.resolution_x, self.engine.resolution_y,
                                         self.border, self.report, eye) for eye in self.eyes()}

    def convert(self, cache: CopyCache | None = None) -> tuple[RenderScene, Framing]:
        """The scene of the frame, and what it is fitted to; cache: what was read of it already."""
        shot = Shot.find(self.depsgraph, self.settings, self.engine.resolution_x, self.engine.resolution_y)
        unknown = shot.unknown_keys()
        begin = len(unknown) / (len(unknown) + 1)
        if unknown:
            with progress.part(0.0, begin), shutter.clock(self.engine, self.depsgraph) as move_to:
                shot.look_ahead(unknown, move_to, self._find_framing)
        with progress.part(begin, 1.0):
            scene = self._convert(shot.settle, cache)
        shot.remember()
        return scene, shot.framing

    def convert_again(self, framing: Framing) -> RenderScene:
        """The scene at another moment of the frame, fitted as the frame is."""
        return self._convert(lambda own: framing)

    def _convert(self, choose_framing: Callable[[Framing], Framing], cache: CopyCache | None = None) -> RenderScene:
        with Baker(self.depsgraph) if self.settings.bake_unknown else nullcontext() as baker:
            return convert(self.depsgraph, self._full_view(), self.settings.conversion, self.report,
                           choose_framing=choose_framing, baker=baker,
                           cycles_world=CyclesWorld(self.engine, self.depsgraph, self.status), cache=cache)

    def _find_framing(self) -> Framing:
        return find_framing(self.depsgraph, self._full_view(), self.settings.conversion,
                            cycles_world=CyclesWorld(self.engine, self.depsgraph, self.status))

    def _full_view(self) -> View:
        """The view of the whole picture, whatever part of it is rendered."""
        return convert_camera(self.depsgraph, self.engine.resolution_x, self.engine.resolution_y, None)
