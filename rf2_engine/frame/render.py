# SPDX-License-Identifier: GPL-3.0-or-later
"""Render one F12: Blender calls `render` once for every view layer of every frame."""
from __future__ import annotations

from collections import Counter

import bpy

from ...model import progress
from ...model.compute import threads
from ...model.errors import RenderCancelled
from ...model.lobes import Lobes
from ...model.scene import RenderScene, View
from ...model.weights.presets import BUNDLED
from .. import passes as pass_table
from ..convert.data.report import Report, grouped
from ..cycles import run as cycles_run
from ..cycles.run import Passes
from ..progress import last_render
from ..progress.last_render import LayerStatistics
from ..progress.stages import CONVERT, DIVIDE, WRITE
from ..progress.status import Status
from ..runtime import failure, model_cache, running
from ..runtime.worker import worker
from ..setup import packages
from . import card, output, reference
from .hits import Hits, first_hits
from .layer import Layer
from .network import Network, Picture
from .optics import Optics
from .trained import told
from .work import layers

LOST = {"unplaced": "without room within Max Triangles (in the picture, but unknown to the network)",
        "skipped": "left out of the picture", "refused": "with data that cannot be used"}


def render(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph) -> None:
    """Render one view layer into `engine`'s result, or say by name what prevents it and leave a frame that shows so."""
    name = depsgraph.view_layer_eval.name  # Cycles frees the depsgraph: whatever is needed later is read now
    running.mark(engine.bl_idname)
    try:  # whatever is raised outside of it leaves an empty frame, which Blender takes for a picture and saves
        done = _render(engine, depsgraph, name)
    except RenderCancelled:
        last_render.add(LayerStatistics(name, cancelled=True))
        if running.is_stopping():  # an error also ends an animation
            engine.report({"ERROR"}, "RenderFormer-V2 was disabled while it rendered")
    except KeyboardInterrupt:  # Ctrl-C in a Python that has imported bpy, which Blender would swallow
        last_render.add(LayerStatistics(name, cancelled=True))
        engine.report({"ERROR"}, "Interrupted")
        engine.error_set("Interrupted")
    except Exception as error:
        _fail(engine, name, failure.message(error))
    else:
        last_render.add(done)
        last_render.stamp(engine)
        _tell(engine, done)


def _render(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, name: str) -> LayerStatistics:
    """The view layer of that name, its progress shown."""
    status, report = Status(engine, name if layers(depsgraph.scene_eval) > 1 else ""), Report()
    optics = Optics.of(depsgraph)
    twice = optics.sessions > 1 or reference.is_wanted(depsgraph.scene_eval)
    with progress.reporting(status), cycles_run.scene_kept(engine, twice):
        return _render_layer(engine, depsgraph, optics, status, report)


def _render_layer(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, optics: Optics, status: Status,
                  report: Report) -> LayerStatistics:
    """The steps of docs/architecture.md, section 2."""
    while not worker.wait_until_idle():  # viewports have the same network
        progress.report()
    packages.require()                                                              # 1. Requirements
    packages.require_cycles()
    threads.sleep_while_waiting()
    layer = Layer.of(engine, depsgraph, optics, status, report)
    settings = layer.settings
    if settings.weights != BUNDLED:
        model_cache.begin_import()
    with threads.limited(settings.threads):
        with layer.plan.enter(CONVERT):
            views = layer.views()                                                   # 2. Camera
            scene = layer.scene()                                                   # 3. Scene
            view = next(iter(views.values()))
            given = told(scene, view, settings, report)
        layer.plan.has_triangles(len(scene))
        passes, tokens = _passes(layer, views, scene, given)                        # 4. to 7.
    with layer.plan.enter(WRITE):
        output.write_views(engine, layer.name, passes)
    beside = Report()
    samples = reference.add(layer, passes, beside) if settings.reference else 0     # 8. Reference
    if tokens:  # otherwise the network had nothing to do
        layer.plan.learn_memory(status.memory_added, len(views) * view.width * view.height, len(scene))
    return LayerStatistics(layer.name, size=(view.width, view.height), triangles=len(scene), tokens=tokens,
                           weights=settings.weights, device=layer.device, seconds=layer.plan.seconds,
                           remarks=[*dict.fromkeys(report.entries + beside.entries)], reference_samples=samples)


def _passes(layer: Layer, views: dict[str, View], scene: RenderScene,
            given: RenderScene) -> tuple[dict[str, Passes], int]:
    """All passes of the picture, as output.write_views has them, and how many tokens the network was given.

    given: the scene as its weights are told it.
    """
    exposure, network = layer.settings.exposure, Network(layer, scene)
    with output.unless_stopped(layer.engine, layer.name, views) as passes:
        hits = first_hits(layer, scene, views, passes)                              # 4. First hits

        def show(lobes: dict[str, Lobes]) -> None:
            for name, each in hits.items():
                combined = {"combined": each.combined(lobes[name].radiance, exposure)}
                pass_table.write(layer.engine, layer.name, passes[name] | combined, name)
                if each.guides.traced is not None:  # else what is shown at first has no light
                    passes[name].update(combined)

        show({name: Lobes(each.preview) for name, each in hits.items()})
        pictures, light = {name: Picture.dark(each, exposure) for name, each in hits.items()}, dict.fromkeys(hits, {})
        if any(network.has_work(each.guides) for each in hits.values()):
            network.load()
            card.warn(layer.settings, given, max(view.width * view.height for view in views.values()), layer.report)
            with threads.team(layer.settings.threads):
                if layer.optics:
                    pictures = network.blurred(hits, show)                          # 7. Blur
                else:
                    pictures = {name: network.sharp(name, views[name], each)        # 5. Network
                                for name, each in hits.items()}
                if layer.lit:                                                       # 6. Passes
                    light = {name: _divided(layer, picture, hits[name], bool(scene.volumes))
                             for name, picture in pictures.items()}
    found = {name: passes[name] | light[name] | _of_picture(picture, hits[name], exposure)
             for name, picture in pictures.items()}
    return found, max(picture.tokens for picture in pictures.values())


def _divided(layer: Layer, picture: Picture, hits: Hits, volumes: bool) -> Passes:
    with layer.plan.enter(DIVIDE):
        return output.light_passes(picture.guides, picture.lobes, hits.passes, volumes, layer.settings.exposure)


def _of_picture(picture: Picture, hits: Hits, exposure: float) -> Passes:
    """What the network has changed, but for its light by lobe."""
    shining = {key: getattr(picture.guides, key) for key in output.SHINING}
    return output.first_hits(shining, exposure) | {
        "combined": picture.combined, pass_table.NOISY.key: output.noisy(picture.combined, hits.passes, exposure)}


def _tell(engine: bpy.types.RenderEngine, done: LayerStatistics) -> None:
    """Print what the picture lacks; one warning if something is missing from it altogether."""
    for group in grouped(done.remarks):
        print(f"RenderFormer-V2: {group}")
    kinds = Counter(remark.kind for remark in done.remarks if remark.name != reference.NAME)
    if lost := ", ".join(f"{kinds[kind]} {words}" for kind, words in LOST.items() if kinds[kind]):
        engine.report({"WARNING"}, f"{lost}: see RenderFormer-V2 > Last Render")


def _fail(engine: bpy.types.RenderEngine, layer: str, message: str) -> None:
    last_render.add(LayerStatistics(layer, error=message))
    output.write_error(engine, layer)
    engine.report({"ERROR"}, message)   # makes scripts stop
    engine.error_set(message)           # shows in the Image Editor
