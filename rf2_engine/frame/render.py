# SPDX-License-Identifier: GPL-3.0-or-later
"""Render one F12: Blender calls `render` once for every view layer of every frame."""
from __future__ import annotations

from typing import NamedTuple

import bpy

from ...model import progress
from ...model.compute import process, threads
from ...model.errors import RenderCancelled
from ...model.light_passes import Lobes
from ...model.scene import RenderScene, View
from ...model.weights.presets import BUNDLED
from .. import passes as pass_table
from ..convert.data.report import Remark, Report, grouped, list_names
from ..convert.fitting.framing import Framing
from ..cycles.evaluated_scene import keep_scene
from ..cycles.run import Passes
from ..progress import last_render
from ..progress.last_render import LayerStatistics
from ..progress.stages import CONVERT, DIVIDE, WRITE
from ..progress.status import Status
from ..runtime import failure, model_cache, running
from ..runtime.worker import worker
from ..setup import packages
from . import card, first_picture, output, reference
from .first_hits import FirstHits, render_first_hits
from .layer import Layer
from .light_groups import group_passes
from .network import LayerNetwork, Picture
from .optics import Optics
from .published_scene import network_input
from .work import count_layers

LOST = {"unplaced": ("has", "have", "no room within Max Triangles (in the picture, but unknown to the network)"),
        "skipped": ("is", "are", "left out of the picture"), "refused": ("has", "have", "data that cannot be used")}


def render(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph) -> None:
    """Render one view layer into `engine`'s result, or say by name what prevents it and leave a frame that shows so."""
    name = depsgraph.view_layer_eval.name  # Cycles frees the depsgraph: whatever is needed later is read now
    running.mark(engine.bl_idname)
    try:  # whatever is raised outside of it leaves an empty frame, which Blender takes for a picture and saves
        statistics = _render(engine, depsgraph, name)
    except RenderCancelled:
        last_render.last_frame.add(LayerStatistics(name, cancelled=True))
        if running.is_stopping():  # an error also ends an animation
            engine.report({"ERROR"}, "RenderFormer-V2 was disabled while it rendered")
    except KeyboardInterrupt:  # Ctrl-C in a Python that has imported bpy, which Blender would swallow
        last_render.last_frame.add(LayerStatistics(name, cancelled=True))
        engine.report({"ERROR"}, "Interrupted")
        engine.error_set("Interrupted")
    except Exception as error:
        _fail(engine, name, failure.message(error))
    else:
        last_render.last_frame.add(statistics)
        last_render.stamp(engine)
        _print_report(engine, statistics)


def _render(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, name: str) -> LayerStatistics:
    """Render the view layer of that name and show its progress."""
    status, report = Status(engine, name if count_layers(depsgraph.scene_eval) > 1 else ""), Report()
    optics = Optics.read(depsgraph)
    runs_twice = optics.sessions > 1 or reference.is_requested(depsgraph.scene_eval)
    with progress.reporting(status), keep_scene(engine, runs_twice):
        return _render_layer(engine, depsgraph, optics, status, report)


def _render_layer(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, optics: Optics, status: Status,
                  report: Report) -> LayerStatistics:
    """The steps of docs/architecture.md, section 2."""
    while not worker.wait_until_idle():  # viewports have the same network
        progress.report()
    packages.require()                                                              # 1. Requirements
    packages.require_cycles()
    process.prepare()
    layer = Layer.read(engine, depsgraph, optics, status, report)
    settings = layer.settings
    if settings.weights != BUNDLED:
        model_cache.begin_import()
    with threads.limited(settings.threads):
        views = layer.views()                                                       # 2. Camera
        with output.unless_stopped(engine, layer.name, views) as passes:
            with layer.plan.enter(CONVERT):
                with progress.part(0.0, 0.1):
                    cache = first_picture.show(layer, views, passes)
                with progress.part(0.1, 1.0):
                    scene, framing = layer.convert(cache)                           # 3. Scene
                view = next(iter(views.values()))
                tokens_scene = network_input(scene, view, settings, report)
            layer.plan.set_triangles(len(scene))
            rendered = _render_passes(layer, views, scene, framing, tokens_scene, passes)   # 4. to 7.
    with layer.plan.enter(WRITE):
        output.write_views(engine, layer.name, rendered.passes)
    reference_report = Report()
    samples = reference.add(layer, rendered.passes, reference_report) if settings.reference else 0  # 8. Reference
    if rendered.device:  # otherwise nothing was loaded
        layer.plan.learn_memory(status.memory_added, len(views) * view.width * view.height, len(scene))
    return LayerStatistics(layer.name, size=(view.width, view.height), triangles=len(scene), tokens=rendered.tokens,
                           weights=settings.weights, device=rendered.device, seconds=layer.plan.seconds,
                           remarks=[*dict.fromkeys(report.entries + reference_report.entries)],
                           reference_samples=samples)


class Rendered(NamedTuple):
    """The picture of a view layer."""

    passes: dict[str, Passes]  # by view, as output.write_views takes them
    tokens: int                # length of the sequence of the transformer; 0 without one
    device: str                # that the network worked on, as in LayerStatistics


def _render_passes(layer: Layer, views: dict[str, View], scene: RenderScene, framing: Framing,
                   tokens_scene: RenderScene, passes: dict[str, Passes]) -> Rendered:
    """tokens_scene: the network's input scene (published_scene.py). passes: of output.unless_stopped."""
    exposure, network = layer.settings.exposure, LayerNetwork(layer, scene, framing)
    hits, optics = render_first_hits(layer, scene, views, passes)                   # 4. First hits

    def show(lobes: dict[str, Lobes]) -> None:
        for name, view_hits in hits.items():
            combined = {"combined": view_hits.composite(lobes[name].radiance, exposure)}
            pass_table.write(layer.engine, layer.name, passes[name] | combined, name)
            if view_hits.guides.traced is not None or "combined" in passes[name]:
                passes[name].update(combined)  # else it has no light, and nobody has seen a first picture

    show({name: Lobes(view_hits.preview) for name, view_hits in hits.items()})
    pictures = {name: Picture.without_light(view_hits, exposure) for name, view_hits in hits.items()}
    light = dict.fromkeys(hits, {})
    if any(network.can_light(view_hits.guides) for view_hits in hits.values()):
        network.load()
        card.warn(layer.settings, tokens_scene, max(view.width * view.height for view in views.values()),
                  layer.report)
        with threads.team(layer.settings.threads):
            if optics:
                pictures = network.render_blurred(hits, optics, show)               # 7. Blur
            else:
                pictures = {name: network.render_sharp(name, views[name], view_hits)        # 5. Network
                            for name, view_hits in hits.items()}
            if layer.with_lobes:                                                    # 6. Passes
                light = {name: _divide_light(layer, picture, hits[name], bool(scene.volumes))
                         for name, picture in pictures.items()}
    complete = {name: passes[name] | light[name] | _picture_passes(picture, hits[name], exposure)
                | group_passes(layer.light_groups, picture.combined, picture.guides, picture.lobes, hits[name], scene)
                for name, picture in pictures.items()}
    return Rendered(complete, max(picture.tokens for picture in pictures.values()), network.device)


def _divide_light(layer: Layer, picture: Picture, hits: FirstHits, has_volumes: bool) -> Passes:
    with layer.plan.enter(DIVIDE):
        return output.light_passes(picture.guides, picture.lobes, hits.passes, has_volumes, layer.settings.exposure)


def _picture_passes(picture: Picture, hits: FirstHits, exposure: float) -> Passes:
    """Combined, and first hits whose edges the network has smoothed."""
    emitted = {key: getattr(picture.guides, key) for key in output.EMITTED}
    return output.first_hit_passes(emitted, exposure) | {
        "combined": picture.combined, pass_table.NOISY.key: output.noisy(picture.combined, hits.passes, exposure)}


def _print_report(engine: bpy.types.RenderEngine, statistics: LayerStatistics) -> None:
    """Print what the picture lacks; one warning if something is missing from it altogether."""
    for group in grouped(statistics.remarks):
        print(f"RenderFormer-V2: {group}")
    if lost := summarize_lost(statistics.remarks):
        engine.report({"WARNING"}, f"{lost}: see RenderFormer-V2 > Last Render")


def summarize_lost(remarks: list[Remark]) -> str:
    """What is missing from the picture, by name: "Fog is left out of the picture"; nothing if nothing is."""
    parts = []
    for kind, (one, many, words) in LOST.items():
        lost = [remark for remark in remarks if remark.kind == kind and remark.name != reference.NAME]
        if lost:
            verb = one if len({remark.name for remark in lost}) == 1 else many
            parts.append(f"{list_names(lost)} {verb} {words}")
    return ", ".join(parts)


def _fail(engine: bpy.types.RenderEngine, layer: str, message: str) -> None:
    last_render.last_frame.add(LayerStatistics(layer, error=message))
    output.write_error(engine, layer)
    engine.report({"ERROR"}, message)   # makes scripts stop
    engine.error_set(message)           # shows in the Image Editor
