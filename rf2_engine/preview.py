# SPDX-License-Identifier: GPL-3.0-or-later
"""Previews of materials, lights and worlds: small pictures by the bundled network, which nobody waits for.

Whatever goes wrong leaves a preview empty and is not spoken of: it is F12 that explains.
"""
from __future__ import annotations

import sys
from contextlib import nullcontext
from dataclasses import replace

import bpy

from ..model import background, progress, threads
from ..model.errors import RenderCancelled
from ..model.presets import BUNDLED
from ..model.scene import RenderScene
from . import cycles_session, model_cache, passes, render, running
from .convert.report import Report
from .settings import FrameSettings
from .setup import packages
from .status import Status

_SETTINGS = FrameSettings(weights=BUNDLED, device="cpu", precision="auto", token_budget=1024, max_edge=0.2,
                          guide_samples=4, light=cycles_session.Light.TRACED, threads=0, film_transparent=False,
                          exposure=1.0)

WITHOUT_SIMPLIFYING = 8192  # triangles: room for Blender's preview scenes as they are

_network = None  # the model.renderer.Renderer of previews: the one of frames may be large, and stays where it is


class _Quiet(Status):
    """Looks at what stops a preview, and says nothing."""

    def holding_the_bar(self):
        return nullcontext()

    def __call__(self, text: str, fraction: float) -> None:
        if self.esc_pressed() or running.is_under_way():
            raise RenderCancelled()


def render_preview(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph) -> None:
    """Draw what Blender's preview panels and icons show."""
    scene = depsgraph.scene_eval
    settings = replace(_SETTINGS, film_transparent=scene.render.film_transparent, exposure=scene.cycles.film_exposure)
    try:
        packages.require()
        if "fast_simplification" in packages.missing():
            settings = replace(settings, token_budget=WITHOUT_SIMPLIFYING)
        threads.sleep_while_waiting()
        status = _Quiet(engine)
        with progress.reporting(status):
            for p in passes.of_view_layer(depsgraph.view_layer_eval):  # a preview's result has Combined alone
                engine.add_pass(p.blender_name, len(p.channels), p.channels, layer=depsgraph.view_layer_eval.name)
            render.draw(engine, depsgraph, settings, None, status, Report(), networks=sys.modules[__name__])
    except Exception:
        pass


def renderer(weights: str, device: str, precision: str):
    """The model.renderer.Renderer of all previews."""
    global _network
    if _network is None:
        _network = background.finish(model_cache.begin_import()).Renderer(weights, device, precision)
    return _network


def encoded(network, scene: RenderScene, picture_size: int):
    """The model.renderer.EncodedScene of `scene`; each preview shows another."""
    return network.encode(scene, picture_size)


def free() -> None:
    """Give the memory of the previews' network back."""
    global _network
    _network = None
