# SPDX-License-Identifier: GPL-3.0-or-later
"""What there is to know of a frame before it is rendered: its work, and what cannot be."""
from __future__ import annotations

import bpy

from ...model.errors import SceneError
from .. import compat, passes
from ..convert.report import Report
from ..cycles.session import Light
from ..settings import FrameSettings
from . import model_cache, reference
from .optics import Optics
from .rectangle import Border

LONGEST_NAME = 63  # bytes of view layer, pass and channel together, of every engine, in a multilayer file


def layers(scene: bpy.types.Scene) -> int:
    """How many view layers this frame renders."""
    return 1 if scene.render.use_single_layer else sum(layer.use for layer in scene.view_layers)


def work(width: int, height: int, part: Border | None, settings: FrameSettings, optics: Optics) -> dict[str, float]:
    """What the stages of one view layer have to do, in the units of costs.py."""
    x0, x1, y0, y1 = part or (0, width, 0, height)
    pixels = (x1 - x0) * (y1 - y0)
    runs = (2 * optics.samples if optics else 1) + optics.holes + 2 * optics.catchers
    smooth = settings.guided and settings.light is Light.TRACED and not (optics or optics.catchers)
    return {"Converting the scene": optics.scenes,
            "First hits": pixels * settings.guide_samples * runs,
            "Loading the network": not model_cache.is_loaded(),
            "Network, scene": settings.token_budget * optics.shutter, "Network, view": pixels * optics.samples,
            "Network, edges": pixels * smooth,
            reference.NAME: pixels * settings.reference.samples if settings.reference else 0}


def check(depsgraph: bpy.types.Depsgraph, settings: FrameSettings, report: Report) -> None:
    """Report what the whole picture lacks. Raises SceneError for what cannot be rendered."""
    scene, layer = depsgraph.scene_eval, depsgraph.view_layer_eval
    if scene.render.use_multiview:
        raise SceneError(f'Scene "{scene.name}" uses stereoscopy, which is not supported: '
                         "switch it off in Output Properties")
    if settings.light is Light.TRACED and not compat.has_openimagedenoise():
        report.approximated(scene.name, "this Blender lacks OpenImageDenoise, so traced hints are noisy: raise "
                                        "Samples, or set Light to Network Alone")
    names = passes.of_session(layer, passes.asked_light(layer, settings.light_passes))
    names += passes.REFERENCE if settings.reference else ()
    longest = max((p.blender_name for p in names), key=len)
    if (room := LONGEST_NAME - len(f".{longest}.X")) < len(layer.name.encode()):
        report.approximated(layer.name, f"Blender cuts names in multilayer files: with more than {room} letters in the "
                                        f'name of the view layer, passes such as "{longest}" get lost')
