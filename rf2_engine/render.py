# SPDX-License-Identifier: GPL-3.0-or-later
"""The journey of one F12: Blender calls `render` once for every view layer of every frame."""
from __future__ import annotations

import bpy
import numpy as np

from ..model import media, progress, threads
from ..model.errors import RenderCancelled, SceneError
from ..model.lighting import Lobes
from ..model.presets import BUNDLED
from ..model.silhouettes import blended
from . import (
    compat,
    costs,
    cycles_run,
    cycles_session,
    failure,
    model_cache,
    output,
    reference,
    running,
    shot,
    statistics,
)
from . import passes as pass_table
from .convert.camera import convert_camera
from .convert.report import Report
from .convert.scene import convert
from .cycles_session import Light
from .guides import make_guides
from .limits import report_limits
from .settings import FrameSettings
from .setup import packages
from .statistics import LayerStatistics
from .status import Status

CYCLES_SHARE = 0.8  # of the first hits; the rest finds the triangles behind them


def render(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph) -> None:
    """Render one view layer into `engine`'s result, or say by name what prevents it and leave a frame that shows so."""
    layer = depsgraph.view_layer_eval.name  # Cycles frees the depsgraph: whatever is needed later is read now
    running.mark(engine.bl_idname)
    status, report = Status(engine), Report()
    try:
        with progress.reporting(status), cycles_run.scene_kept(engine, reference.is_wanted(depsgraph.scene_eval)):
            done = _render_layer(engine, depsgraph, layer, status, report)
    except RenderCancelled:
        statistics.last_frame.append(LayerStatistics(layer, cancelled=True))
        if running.is_stopping():  # an error also ends an animation
            engine.report({"ERROR"}, "RenderFormer-V2 was disabled while it rendered")
    except Exception as error:
        _fail(engine, layer, failure.message(error))
    else:
        statistics.last_frame.append(done)
        statistics.stamp(engine)
        _tell(engine, done)


def _render_layer(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, layer: str, status: Status,
                  report: Report) -> LayerStatistics:
    packages.require()
    cycles_session.require()
    threads.sleep_while_waiting()
    model_cache.begin_import()
    settings = FrameSettings.of(depsgraph.scene_eval)
    lit = pass_table.asked_light(depsgraph.view_layer_eval, settings.light_passes)
    check(depsgraph.scene_eval, settings, report)
    report_limits(depsgraph, report)
    width, height = engine.resolution_x, engine.resolution_y
    border = border_of(width, height, depsgraph.scene_eval.render)
    expected, loaded = work(width, height, border, settings), model_cache.is_loaded()
    status.expect(layer, layers(depsgraph.scene_eval), expected, settings.setup)

    with status.stage("Converting the scene"):
        view = convert_camera(depsgraph, width, height, border, report)
        whole = convert_camera(depsgraph, width, height, None)  # without its border
        scene = convert(depsgraph, whole, token_budget=settings.token_budget, max_edge=settings.max_edge,
                        report=report, steady=shot.steady(depsgraph))
    expected["Network, scene"] = len(scene)
    has_content = len(scene) or scene.volumes
    renderer = None
    if has_content and settings.weights != BUNDLED:  # wrong weights are found before Cycles has worked for nothing
        renderer = _load(status, settings)
    with output.unless_stopped(engine, layer) as passes:
        with status.stage("First hits"):
            lit_by = " and direct light" if settings.light is Light.TRACED else ""
            with status.during_cycles(f"First hits{lit_by} {{}}", share=CYCLES_SHARE):
                found = cycles_session.render_passes(engine, depsgraph, samples=settings.guide_samples,
                                                     light=settings.light, hazy=bool(scene.volumes),
                                                     threads=settings.threads, report=report)
            passes |= output.first_hits(found, settings.exposure)
            with progress.part(CYCLES_SHARE, 1.0):
                guides = make_guides(found, scene, view)
            found |= {key: getattr(guides, key) for key in media.PASSES}  # through smoke and fog these are less noisy
            passes |= output.first_hits(found, settings.exposure)

        def combined(radiance: np.ndarray) -> np.ndarray:
            return output.composite(radiance, guides, settings.film_transparent, settings.exposure)

        first = guides.traced  # what there is to show until the network is done
        if first is None:
            first = guides.diffuse_color + guides.glossy_color + guides.transmission_color
        output.write(engine, layer, passes | {"combined": combined(first)})
        radiance, tokens, light = np.zeros((view.height, view.width, 3), np.float32), 0, {}
        if guides.alpha.any() and has_content:
            renderer = renderer or _load(status, settings)  # PyTorch was imported meanwhile
            with threads.team(settings.threads):
                with status.stage("Network", "scene"):
                    encoded = model_cache.encoded(renderer, scene, view.longer_side)
                with status.stage("Network", "view"):
                    with progress.part(0.0, 0.8):
                        lobes = encoded.lobes(view, guides) if lit else Lobes(encoded.view(view, guides))
                    if settings.guided:
                        with progress.part(0.8, 0.9, "Blending edges"):
                            lobes = blended(lobes, guides, found["normal"])
                    if lit:
                        with progress.part(0.9, 1.0, "Dividing the light"):
                            light = output.light_passes(guides, lobes, found, bool(scene.volumes), settings.exposure)
                    radiance, tokens = lobes.radiance, encoded.tokens
    with status.stage("Writing passes"):
        picture = passes | light | {"combined": combined(radiance)}
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


def layers(scene: bpy.types.Scene) -> int:
    """How many view layers this frame renders."""
    return 1 if scene.render.use_single_layer else sum(layer.use for layer in scene.view_layers)


def work(width: int, height: int, border: tuple[int, int, int, int] | None,
         settings: FrameSettings) -> dict[str, float]:
    """What the stages of one view layer have to do, in the units of costs.py."""
    x0, x1, y0, y1 = border or (0, width, 0, height)
    pixels = (x1 - x0) * (y1 - y0)
    return {"Converting the scene": 1, "First hits": pixels * settings.guide_samples,
            "Loading the network": not model_cache.is_loaded(),
            "Network, scene": settings.token_budget, "Network, view": pixels,
            reference.NAME: pixels * settings.reference.samples if settings.reference else 0}


def check(scene: bpy.types.Scene, settings: FrameSettings, report: Report) -> None:
    """Report what the whole picture lacks. Raises SceneError for what cannot be rendered."""
    if scene.render.use_multiview:
        raise SceneError(f'Scene "{scene.name}" uses stereoscopy, which is not supported: '
                         "switch it off in Output Properties")
    if settings.light is Light.TRACED and not compat.has_openimagedenoise():
        report.approximated(scene.name, "this Blender lacks OpenImageDenoise, so traced hints are noisy: raise "
                                        "Samples, or set Light to Network Alone")
    if scene.render.use_motion_blur:
        report.approximated(scene.name, "motion blur is left out")
    if scene.camera and scene.camera.type == "CAMERA" and scene.camera.data.dof.use_dof:
        report.approximated(scene.camera.name, "depth of field is left out")


def border_of(width: int, height: int, settings: bpy.types.RenderSettings) -> tuple[int, int, int, int] | None:
    """Pixels (x0, x1, y0, y1) from the bottom left, rounded as Blender does; None without a render border."""
    if not settings.use_border:
        return None
    size = np.float32([width, width, height, height])
    border = np.float32([settings.border_min_x, settings.border_max_x, settings.border_min_y, settings.border_max_y])
    return tuple((border * size).astype(int).tolist())


def _tell(engine: bpy.types.RenderEngine, done: LayerStatistics) -> None:
    """Print what the picture lacks; one warning if something is missing from it altogether."""
    for line in done.report:
        print(f"RenderFormer-V2: {line}")
    lost = sum(remark.kind != "approximated" and remark.name != reference.NAME for remark in done.remarks)
    if lost:
        engine.report({"WARNING"}, f"{lost} things are not in the picture: see RenderFormer-V2 > Last Render")


def _fail(engine: bpy.types.RenderEngine, layer: str, message: str) -> None:
    statistics.last_frame.append(LayerStatistics(layer, error=message))
    output.write_error(engine, layer)
    engine.report({"ERROR"}, message)   # makes scripts stop
    engine.error_set(message)           # shows in the Image Editor
