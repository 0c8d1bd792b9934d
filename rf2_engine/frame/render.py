# SPDX-License-Identifier: GPL-3.0-or-later
"""The journey of one F12: Blender calls `render` once for every view layer of every frame."""
from __future__ import annotations

import bpy
import numpy as np

from ...model import denoise_media, progress, threads
from ...model.errors import RenderCancelled
from ...model.lobes import Lobes
from ...model.presets import BUNDLED
from .. import passes as pass_table
from ..convert.report import Report
from ..cycles import run as cycles_run
from ..cycles import session as cycles_session
from ..progress import costs, last_render
from ..progress.last_render import LayerStatistics
from ..progress.status import Status
from ..settings import FrameSettings
from ..setup import packages
from . import checks, failure, model_cache, output, rectangle, reference, running
from .guides import guides_of_no_triangle
from .layer import CYCLES_SHARE, Layer
from .limits import report_limits
from .optics import Optics


def render(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph) -> None:
    """Render one view layer into `engine`'s result, or say by name what prevents it and leave a frame that shows so."""
    layer = depsgraph.view_layer_eval.name  # Cycles frees the depsgraph: whatever is needed later is read now
    running.mark(engine.bl_idname)
    status, report, optics = Status(engine), Report(), Optics.of(depsgraph)
    twice = optics.sessions > 1 or reference.is_wanted(depsgraph.scene_eval)
    try:
        with progress.reporting(status), cycles_run.scene_kept(engine, twice):
            done = _render_layer(engine, depsgraph, layer, optics, status, report)
    except RenderCancelled:
        last_render.last_frame.append(LayerStatistics(layer, cancelled=True))
        if running.is_stopping():  # an error also ends an animation
            engine.report({"ERROR"}, "RenderFormer-V2 was disabled while it rendered")
    except Exception as error:
        _fail(engine, layer, failure.message(error))
    else:
        last_render.last_frame.append(done)
        last_render.stamp(engine)
        _tell(engine, done)


def _render_layer(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, layer: str, optics: Optics,
                  status: Status, report: Report) -> LayerStatistics:
    packages.require()
    cycles_session.require()
    threads.sleep_while_waiting()
    settings = FrameSettings.of(depsgraph.scene_eval, depsgraph.view_layer_eval)
    if settings.weights != BUNDLED:
        model_cache.begin_import()
    lit = pass_table.asked_light(depsgraph.view_layer_eval, settings.light_passes)
    checks.check(depsgraph, settings, report)
    report_limits(depsgraph, report)
    optics = optics.possible(settings.light, depsgraph, report)
    width, height = engine.resolution_x, engine.resolution_y
    border = rectangle.border(width, height, depsgraph.scene_eval.render)
    expected, loaded = checks.work(width, height, border, settings, optics), model_cache.is_loaded()
    status.expect(layer, checks.layers(depsgraph.scene_eval), expected, settings.setup)
    job = Layer(engine, depsgraph, settings, optics, border, status, report, lit)

    with status.stage("Converting the scene", share=1 / optics.scenes):
        view, scene = job.view(), job.scene()
    expected["Network, scene"] = len(scene) * optics.shutter
    has_content = len(scene) or scene.volumes
    renderer = None
    if has_content and settings.weights != BUNDLED:  # wrong weights are found before Cycles has worked for nothing
        renderer = _load(status, settings)
    model_cache.begin_import()  # while Cycles works, which leaves Python alone
    with output.unless_stopped(engine, layer) as passes:
        with status.stage("First hits", share=1 / 2 if optics else 1):
            opacity, catch = job.opacity(view), job.catch()
            found = job.first_hits(scene, optics.look(), settings.guide_samples * optics.samples)
            passes |= output.first_hits(found, settings.exposure)
            if optics.samples == 1 and not found["transmission_color"].any():  # no glass to see the film through
                job.optics = optics = Optics()
            if optics:
                guides = guides_of_no_triangle(found)
            else:
                with progress.part(CYCLES_SHARE, 1.0):
                    guides = job.guides(found, scene, view)
                # Through smoke these are less noisy.
                found |= {key: getattr(guides, key) for key in denoise_media.PASSES}
                passes |= output.first_hits(found, settings.exposure)

        def combined(radiance: np.ndarray) -> np.ndarray:
            return output.composite(radiance, guides, opacity, catch, settings.exposure)

        def show(lobes: Lobes) -> None:
            output.write(engine, layer, passes | {"combined": combined(lobes.radiance)})

        first = guides.traced  # what there is to show until the network is done
        if first is None:
            first = guides.diffuse_color + guides.glossy_color + guides.transmission_color
        show(Lobes(first))
        whole, tokens, light = combined(np.zeros((view.height, view.width, 3), np.float32)), 0, {}
        if has_content and (guides.alpha.any() or guides.transmission_color.any()):
            renderer = renderer or _load(status, settings)  # PyTorch was imported meanwhile
            with threads.team(settings.threads):
                if optics:
                    lobes, tokens = job.blurred(renderer, scene, guides, show)
                    whole = combined(lobes.radiance)
                else:
                    encoded = job.encoded(renderer, scene, view)
                    lobes, tokens = job.lobes(encoded, view, guides, found["normal"]), encoded.tokens
                    whole = combined(lobes.radiance)
                    if settings.guided and guides.traced is not None and catch is None:
                        lobes, guides, whole = job.antialiased(encoded, lobes, guides, whole)
                        shining = {key: getattr(guides, key) for key in output.SHINING}
                        passes |= output.first_hits(shining, settings.exposure)
                if lit:
                    with status.stage("Dividing the light"):
                        light = output.light_passes(guides, lobes, found, bool(scene.volumes), settings.exposure)
    with status.stage("Writing passes"):
        noisy = output.noisy(whole, found, settings.exposure)
        picture = passes | light | {"combined": whole, pass_table.NOISY.key: noisy}
        output.write(engine, layer, picture)
    beside = Report()
    samples = reference.add(engine, depsgraph, picture, settings, status, beside) if settings.reference else 0
    if tokens:  # otherwise the network had nothing to do
        costs.learn_memory(settings.setup, loaded, status.memory_added, view.width * view.height, len(scene))
    return LayerStatistics(layer, size=(view.width, view.height), triangles=len(scene), tokens=tokens,
                           weights=settings.weights, seconds=status.seconds,
                           remarks=[*dict.fromkeys(report.entries + beside.entries)], reference_samples=samples)


def _load(status: Status, settings: FrameSettings):
    with status.stage("Loading the network"):
        return model_cache.renderer(settings.weights, settings.device, settings.precision)


def _tell(engine: bpy.types.RenderEngine, done: LayerStatistics) -> None:
    """Print what the picture lacks; one warning if something is missing from it altogether."""
    for line in done.report:
        print(f"RenderFormer-V2: {line}")
    lost = sum(remark.kind != "approximated" and remark.name != reference.NAME for remark in done.remarks)
    if lost:
        engine.report({"WARNING"}, f"{lost} things are not in the picture: see RenderFormer-V2 > Last Render")


def _fail(engine: bpy.types.RenderEngine, layer: str, message: str) -> None:
    last_render.last_frame.append(LayerStatistics(layer, error=message))
    output.write_error(engine, layer)
    engine.report({"ERROR"}, message)   # makes scripts stop
    engine.error_set(message)           # shows in the Image Editor
