# SPDX-License-Identifier: GPL-3.0-or-later
"""The moments while the shutter is open, and the scene at each of them."""
from __future__ import annotations

from contextlib import contextmanager

import bpy
import numpy as np

from ..cycles import evaluated_scene

CURVE_STEPS = 256


def moments(scene: bpy.types.Scene, count: int) -> np.ndarray:
    """(count,) frames at which each of `count` equal shares of the light of an exposure is half done."""
    settings = scene.render
    curve = settings.motion_blur_shutter_curve
    curve.initialize()
    time = (np.arange(CURVE_STEPS) + 0.5) / CURVE_STEPS
    light = np.cumsum([max(curve.evaluate(curve.curves[0], x), 0.0) for x in time.tolist()])
    if light[-1] > 0:
        time = np.interp((np.arange(count) + 0.5) / count, (light - light[0] / 2) / light[-1], time)
    else:
        time = (np.arange(count) + 0.5) / count
    opens = {"START": 0.0, "CENTER": 0.5, "END": 1.0}[settings.motion_blur_position]
    return scene.frame_float + settings.motion_blur_shutter * (time - opens)


@contextmanager
def clock(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph):
    """A function that evaluates the scene at a frame, inside keep_scene; in the end it is back at its own.

    The function returns what has changed: {"camera", "scene"}, one of them or nothing.
    """
    scene = depsgraph.scene_eval
    now = current = scene.frame_float

    def move_to(moment: float) -> set[str]:
        nonlocal current
        if moment == current:
            evaluated_scene.restore_objects(engine, depsgraph)
            return set()
        current = moment
        frame = int(np.floor(moment))
        evaluated_scene.evaluate_at(engine, depsgraph, frame, moment - frame)
        changed = {"camera" if _is_camera(update.id) else "scene" for update in depsgraph.updates
                   if not _is_back_in_time(update.id)}
        evaluated_scene.restore_objects(engine, depsgraph)
        return changed
    try:
        yield move_to
    finally:
        move_to(now)


def _is_back_in_time(data: bpy.types.ID) -> bool:
    """Whether evaluated_scene.evaluate_at alone has changed it: a scene without animation of its own."""
    return isinstance(data, bpy.types.Scene) and data.animation_data is None and not any(
        marker.camera for marker in data.timeline_markers)


def _is_camera(data: bpy.types.ID) -> bool:
    """Whether a change of this data-block changes nothing but cameras."""
    if isinstance(data, bpy.types.Object):
        return data.type == "CAMERA" or data.type == "EMPTY" and data.instance_type == "NONE"
    return isinstance(data, (bpy.types.Camera, bpy.types.Action, bpy.types.Scene))
