# SPDX-License-Identifier: GPL-3.0-or-later
"""The network's box, the view that triangles are allotted by, and how many each mesh gets, held still over a shot:
light flickers in a scene that is fitted and simplified anew for every frame.

A shot lasts from the first frame of a render job, for as long as the camera stays the same and looks at about the
same place. Where frames are rendered apart from each other, by a farm, all this is as in the shot's first frame all the
same, whatever frame a job begins with.
"""
from __future__ import annotations

from collections.abc import Callable
from contextlib import contextmanager

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ..convert.camera.framing import Framing
from ..registering import handlers

LARGEST_ZOOM = 2.0  # of the box that would be right, against the one that is kept, either way
FARTHEST = 1.0      # between their centres, in sides of the kept one

_kept: dict[tuple[str, str, str], Framing] = {}  # by scene, view layer and camera


def begins_at(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph) -> int | None:
    """The frame that has to be converted first, because its shot begins there; None if that is done, or is this one."""
    scene = depsgraph.scene_eval
    if not engine.is_animation or _key(depsgraph) in _kept:
        return None
    switched = [marker.frame for marker in depsgraph.scene.timeline_markers
                if marker.camera and marker.frame <= scene.frame_current]
    first = max([scene.frame_start, *switched])
    return first if first < scene.frame_current <= scene.frame_end else None


def steady(depsgraph: bpy.types.Depsgraph) -> Callable[[Framing], Framing]:
    """A function that takes what this frame would be fitted to and gives what its shot is."""
    key = _key(depsgraph)

    def settled(framing: Framing) -> Framing:
        if key not in _kept or _has_left(_kept[key].box, framing.box):
            _kept[key] = framing
        return _kept[key]

    return settled


def _key(depsgraph: bpy.types.Depsgraph) -> tuple[str, str, str]:
    scene = depsgraph.scene_eval
    return scene.name, depsgraph.view_layer_eval.name, scene.camera.name if scene.camera else ""


def _has_left(kept: np.ndarray, box: np.ndarray) -> bool:
    size, new = (float((b[1] - b[0]).max()) for b in (kept, box))
    apart = np.abs(box.sum(axis=0) - kept.sum(axis=0)).max() / 2
    return not size / LARGEST_ZOOM <= new <= size * LARGEST_ZOOM or apart > FARTHEST * size


@contextmanager
def going_on():
    """Inside, several render jobs are one animation."""
    bpy.app.handlers.render_init.remove(_forget)
    _forget()
    try:
        yield
    finally:
        bpy.app.handlers.render_init.append(_forget)


@persistent
def _forget(*_):
    _kept.clear()


register, _remove_handlers = handlers(("render_init", _forget))


def unregister() -> None:
    _kept.clear()
    _remove_handlers()
