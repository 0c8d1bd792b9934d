# SPDX-License-Identifier: GPL-3.0-or-later
"""The journey of one F12: Blender calls `render` once for every view layer of every frame."""
from __future__ import annotations

import traceback

import bpy
import numpy as np

from ..model import progress
from ..model.errors import CheckpointError, RenderCancelled, SceneError
from . import cycles_session, model_cache, output
from .convert.camera import convert_camera
from .convert.report import Report
from .convert.scene import convert
from .guides import make_guides
from .setup import packages
from .status import Status

# What the last render was made of and how long it took: {"layer", "size" (w, h), "triangles", "tokens", "weights",
# "seconds" {stage: s}, "report" [str]}, or {"layer", "error"}; empty before the first. Replaced, not changed in place.
last_statistics: dict = {}


def render(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph) -> None:
    """Render one view layer into `engine`'s result, or say by name what prevents it and leave a frame that shows so."""
    layer = depsgraph.view_layer_eval.name  # Cycles frees the depsgraph: whatever is needed later is read now
    try:
        _render_layer(engine, depsgraph, layer)
    except RenderCancelled:
        return
    except (SceneError, CheckpointError, packages.MissingPackages) as error:
        _fail(engine, layer, str(error))
    except Exception as error:
        if type(error).__name__ == "OutOfMemoryError" or isinstance(error, MemoryError):
            _fail(engine, layer, "Out of memory: lower the Triangle Budget or the resolution, or set Device to CPU")
        else:
            traceback.print_exc()
            _fail(engine, layer, f"Internal error, please report it with the console's text: {error!r}")


def _render_layer(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, layer: str) -> None:
    global last_statistics
    packages.require()
    cycles_session.require()
    model_cache.begin_import()
    scene, report, status = depsgraph.scene_eval, Report(), Status(engine)
    settings = depsgraph.scene.renderformer_v2
    weights, device, precision = settings.weights(), settings.device, settings.precision
    samples = settings.guide_samples
    film_transparent, exposure = scene.render.film_transparent, scene.cycles.film_exposure
    if scene.render.use_multiview:
        raise SceneError(f'Scene "{scene.name}" uses stereoscopy, which is not supported: '
                         "switch it off in Output Properties")
    if scene.render.use_motion_blur:
        report.approximated(scene.name, "motion blur is left out")
    if scene.camera and scene.camera.type == "CAMERA" and scene.camera.data.dof.use_dof:
        report.approximated(scene.camera.name, "depth of field is left out")

    with status.stage("Converting the scene", 0.0, 0.1):
        view = convert_camera(depsgraph, engine.resolution_x, engine.resolution_y,
                              _border(engine, scene.render), report)
        with progress.reporting(status):
            tokens = convert(depsgraph, token_budget=settings.token_budget, max_edge=settings.max_edge, report=report)
    with status.stage("First hits", 0.1, 0.2):
        passes = cycles_session.render_passes(engine, depsgraph, samples=samples, lighting=False)
        with progress.reporting(status):
            guides = make_guides(passes, tokens, view)

    def write(radiance: np.ndarray) -> None:
        combined = output.composite(radiance, guides, film_transparent, exposure)
        output.write(engine, layer, passes | {"combined": combined})

    with status.stage("Writing passes", 0.2, 0.2):  # unlit colours, until the network is done
        write(guides.diffuse_color + guides.glossy_color + guides.transmission_color)
    visible = guides.alpha.any() and (len(tokens) or tokens.volumes)
    radiance, length = np.zeros((view.height, view.width, 3), np.float32), 0
    if visible:
        with status.stage("Loading the network", 0.2, 0.25):
            with progress.reporting(status):
                renderer = model_cache.renderer(weights, device, precision)
        with status.stage("Network", 0.25, 1.0):
            with progress.reporting(status), progress.part(0.0, 0.5):
                encoded = model_cache.encoded(renderer, tokens, view.longer_side)
            with progress.reporting(status), progress.part(0.5, 1.0):
                radiance, length = encoded.view(view, guides), encoded.tokens
    with status.stage("Writing passes", 1.0, 1.0):
        write(radiance)

    last_statistics = {"layer": layer, "size": (view.width, view.height), "triangles": len(tokens), "tokens": length,
                       "weights": weights, "seconds": status.seconds, "report": report.lines()}
    _tell(engine, report)


def _border(engine: bpy.types.RenderEngine, settings: bpy.types.RenderSettings) -> tuple[int, int, int, int] | None:
    """Pixels (x0, x1, y0, y1) from the bottom left, rounded as Blender does; None without a render border."""
    if not settings.use_border:
        return None
    size = np.float32([engine.resolution_x, engine.resolution_x, engine.resolution_y, engine.resolution_y])
    border = np.float32([settings.border_min_x, settings.border_max_x, settings.border_min_y, settings.border_max_y])
    return tuple((border * size).astype(int).tolist())


def _tell(engine: bpy.types.RenderEngine, report: Report) -> None:
    """Print what the picture lacks; one warning if something is missing from it altogether."""
    for line in report.lines():
        print(f"RenderFormer-V2: {line}")
    lost = sum(kind != "approximated" for kind, _, _ in report.entries)
    if lost:
        engine.report({"WARNING"}, f"{lost} things are not in the picture: see RenderFormer-V2 > Last Render")


def _fail(engine: bpy.types.RenderEngine, layer: str, message: str) -> None:
    global last_statistics
    last_statistics = {"layer": layer, "error": message}
    output.write_error(engine, layer)
    engine.report({"ERROR"}, message)   # makes scripts stop
    engine.error_set(message)           # shows in the Image Editor
