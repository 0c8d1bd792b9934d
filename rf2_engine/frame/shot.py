# SPDX-License-Identifier: GPL-3.0-or-later
"""Key frames of an animation: later frames use their box, view and shares of triangles.

Light flickers in a scene that is fitted and simplified anew for every frame. So the box, the view that triangles are
allotted by and the shares of the meshes are those of a key frame: the one in which the shot begins, for as long as the
camera looks at about the same place, and later the one in which the frame's block begins. Which of them it is follows
from the frame's number and the scene alone, so that a frame is the same in whatever order, and on however many
computers, frames are rendered. A shot begins at the scene's first frame, or where a marker binds the camera.
"""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ...model import progress
from ..convert.fitting.framing import Framing
from ..frame_settings import FrameSettings
from ..registering import handlers

BLOCK = 32          # frames that are fitted alike once the camera has left the place where the shot began
LARGEST_ZOOM = 2.0  # ratio of the sizes of a frame's own box and the one in use, either way
FARTHEST = 1.0      # distance of their centres, in sides of the one in use
TOLERANCE = 1.5     # times as far may a frame be from the beginning of its block before it is fitted by itself

_fitted: dict[tuple, Framing] = {}   # by Shot.rendered and key frame
_begins: dict[str, int] = {}         # first frames of scenes as they were loaded or saved; `-s 10 -a` changes them


@dataclass
class Shot:
    """One frame of a view layer, and the key frames that it is fitted by.

    keys: where the shot and the block begin, one where that is the same; none before the animation.
    """

    frame: float
    keys: tuple[int, ...]
    rendered: tuple                 # what is rendered and how: frames with the same are fitted alike
    own: Framing | None = None      # what this frame is fitted to by itself
    framing: Framing | None = None  # what it is fitted to after all
    key_framings: dict[int, Framing | None] = field(default_factory=dict)  # None: the scene is as in this frame

    @classmethod
    def find(cls, depsgraph: bpy.types.Depsgraph, settings: FrameSettings, width: int, height: int) -> Shot:
        scene = depsgraph.scene_eval
        camera = scene.camera.name if scene.camera else ""
        rendered = (scene.name, depsgraph.view_layer_eval.name, camera, width, height, settings.token_budget,
                    settings.max_edge, settings.as_is)
        shot = cls(scene.frame_float, _keys(depsgraph.scene, scene.frame_float), rendered)
        shot.key_framings = {key: _fitted.get((*rendered, key)) for key in shot.keys}
        return shot

    def unknown_keys(self) -> list[int]:
        """Key frames that have to be looked at before this frame is settled."""
        return [key for key in self.keys if self.key_framings[key] is None and key != self.frame]

    def look_ahead(self, keys: list[int], move_to: Callable[[int], set[str]],
                   find_framing: Callable[[], Framing]) -> None:
        """Find what these key frames are fitted to by themselves.

        move_to: evaluates the scene at a frame and returns what has changed.
        find_framing: fits the scene as it is then.
        """
        framing = None
        for i, key in enumerate(keys):
            with progress.part(i / len(keys), (i + 1) / len(keys)):
                progress.report()
                if move_to(key):
                    framing = find_framing()
                self.key_framings[key] = framing

    def settle(self, own: Framing) -> Framing:
        """Decide what the frame is fitted to: what a key frame is, or `own`."""
        self.own = self.framing = own
        if self.keys:
            framings = [self.key_framings[key] or own for key in self.keys]  # of the shot and of the block, or of both
            key_framing = framings[-1] if has_left(framings[0].box, framings[-1].box) else framings[0]
            if not has_left(key_framing.box, own.box, TOLERANCE):
                self.framing = key_framing
        return self.framing

    def remember(self) -> None:
        """Keep it for other frames, now that the shares of this one are known too."""
        _fitted.update({(*self.rendered, key): self.key_framings[key] or self.own for key in self.keys})


def has_left(current: np.ndarray, box: np.ndarray, tolerance: float = 1.0) -> bool:
    """Whether a picture with a box (2, 3) of its own is too far from the `current` box to be fitted to that."""
    size, new = (float((b[1] - b[0]).max()) for b in (current, box))
    distance = np.abs(box.sum(axis=0) - current.sum(axis=0)).max() / 2
    zoom = LARGEST_ZOOM * tolerance
    return not size / zoom <= new <= size * zoom or distance > FARTHEST * tolerance * size


def _keys(scene: bpy.types.Scene, frame: float) -> tuple[int, ...]:
    camera_switches = [marker.frame for marker in scene.timeline_markers if marker.camera and marker.frame <= frame]
    begin = _begins.get(scene.name, scene.frame_start)
    first = max([begin if bpy.app.background else min(scene.frame_start, begin), *camera_switches])
    if frame < first:
        return ()
    return tuple(sorted({first, first + int(frame - first) // BLOCK * BLOCK}))


@persistent
def _forget(*_) -> None:
    _fitted.clear()


@persistent
def _note_edit(_, depsgraph: bpy.types.Depsgraph) -> None:
    if depsgraph.mode == "VIEWPORT":  # that of a render is evaluated for every picture
        _fitted.clear()


@persistent
def _note_beginnings(*_) -> None:
    _begins.clear()
    _begins.update({scene.name: scene.frame_start for scene in bpy.data.scenes})


register, _remove_handlers = handlers(("load_post", _forget), ("depsgraph_update_post", _note_edit),
                                      ("load_post", _note_beginnings), ("save_post", _note_beginnings))


def unregister() -> None:
    _fitted.clear()
    _begins.clear()
    _remove_handlers()
