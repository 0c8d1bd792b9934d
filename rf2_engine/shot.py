# SPDX-License-Identifier: GPL-3.0-or-later
"""The network's box, and the view that triangles are allotted by, held still over a shot: light flickers in a scene
that is fitted and simplified anew for every frame.

A shot lasts from the first frame of a render job, for as long as the camera stays the same and looks at about the
same place.
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


def steady(depsgraph: bpy.types.Depsgraph) -> Callable[[np.ndarray, View], tuple[np.ndarray, View]]:
    """A function that takes the box (2, 3) and the view of this frame and gives those of its shot."""
    scene = depsgraph.scene_eval
    key = scene.name, depsgraph.view_layer_eval.name, scene.camera.name if scene.camera else ""

    def settled(box: np.ndarray, view: View) -> tuple[np.ndarray, View]:
        if key not in _kept or _has_left(_kept[key][0], box):
            _kept[key] = box, view
        return _kept[key]

    return settled


def _has_left(kept: np.ndarray, box: np.ndarray) -> bool:
    size, new = (float((b[1] - b[0]).max()) for b in (kept, box))
    apart = np.abs(box.sum(axis=0) - kept.sum(axis=0)).max() / 2
    return not size / LARGEST_ZOOM <= new <= size * LARGEST_ZOOM or apart > FARTHEST * size


@persistent
def _begin(*_):
    _kept.clear()


register, _remove_handlers = handlers(("render_init", _begin))


def unregister() -> None:
    _kept.clear()
    _remove_handlers()
