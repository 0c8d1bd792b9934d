# SPDX-License-Identifier: GPL-3.0-or-later
"""The network's box, and the view that triangles are allotted by, held still over a shot: light flickers in a scene
that is fitted and simplified anew for every frame.

A shot lasts from the first frame of a render job, for as long as the camera stays the same and looks at about the
same place. Where frames are rendered apart from each other, by a farm, the box is that of the shot's first frame all
the same, whatever frame a job begins with.
"""
from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ..model.scene import View
from .registering import handlers

LARGEST_ZOOM = 2.0  # of the box that would be right, against the one that is kept, either way
FARTHEST = 1.0      # between their centres, in sides of the kept one

_kept: dict[tuple[str, str, str], tuple[np.ndarray, View]] = {}  # by scene, view layer and camera


def begins_at(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph) -> int | None:
    """The frame that the box of this shot is to be taken from; None if it is known, or that of this frame is right."""
    scene = depsgraph.scene_eval
    if not engine.is_animation or _key(depsgraph) in _kept:
        return None
    switched = [marker.frame for marker in depsgraph.scene.timeline_markers
                if marker.camera and marker.frame <= scene.frame_current]
    first = max([scene.frame_start, *switched])
    return first if first < scene.frame_current <= scene.frame_end else None


def begin(depsgraph: bpy.types.Depsgraph, box: np.ndarray, view: View) -> None:
    """Take the box and the view of this evaluated frame for the shot of its camera."""
    _kept[_key(depsgraph)] = box, view


def steady(depsgraph: bpy.types.Depsgraph) -> Callable[[np.ndarray, View], tuple[np.ndarray, View]]:
    """A function that takes the box (2, 3) and the view of this frame and gives those of its shot."""
    key = _key(depsgraph)

    def settled(box: np.ndarray, view: View) -> tuple[np.ndarray, View]:
        if key not in _kept or _has_left(_kept[key][0], box):
            _kept[key] = box, view
        return _kept[key]

    return settled


def _key(depsgraph: bpy.types.Depsgraph) -> tuple[str, str, str]:
    scene = depsgraph.scene_eval
    return scene.name, depsgraph.view_layer_eval.name, scene.camera.name if scene.camera else ""


def _has_left(kept: np.ndarray, box: np.ndarray) -> bool:
    size, new = (float((b[1] - b[0]).max()) for b in (kept, box))
    apart = np.abs(box.sum(axis=0) - kept.sum(axis=0)).max() / 2
    return not size / LARGEST_ZOOM <= new <= size * LARGEST_ZOOM or apart > FARTHEST * size


@persistent
def _forget(*_):
    _kept.clear()


register, _remove_handlers = handlers(("render_init", _forget))


def unregister() -> None:
    _kept.clear()
    _remove_handlers()
