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
from ..registering import handlers
from ..settings import FrameSettings

BLOCK = 32          # frames that are fitted alike once the camera has left the place where the shot began
LARGEST_ZOOM = 2.0  # of the box that would be right, against the one that is kept, either way
FARTHEST = 1.0      # between their centres, in sides of the kept one
WITHIN = 1.5        # times as far may a frame be from the beginning of its block, before it is fitted by itself

_fitted: dict[tuple, Framing] = {}   # by what is rendered how, and key frame
_begins: dict[str, int] = {}         # first frames of scenes as they were loaded or saved; `-s 10 -a` changes them


@dataclass
class Shot:
    """One frame of a view layer, and the key frames that it is fitted by.

    keys: where the shot and the block begin, one where that is the same; none before the animation.
    """

    frame: float
    keys: tuple[int, ...]
    rendered: tuple                                   # what is rendered how
    own: Framing | None = None
    known: dict[int, Framing | None] = field(default_factory=dict)  # of keys; None: the scene is as in this frame

    @classmethod
    def of(cls, depsgraph: bpy.types.Depsgraph, settings: FrameSettings, width: int, height: int) -> Shot:
        scene = depsgraph.scene_eval
        camera = scene.camera.name if scene.camera else ""
        rendered = (scene.name, depsgraph.view_layer_eval.name, camera, width, height, settings.token_budget,
                    settings.max_edge, settings.as_is)
        shot = cls(scene.frame_current_final, _keys(depsgraph.scene, scene.frame_current_final), rendered)
        shot.known = {key: _fitted.get((*rendered, key)) for key in shot.keys}
        return shot

    def unknown(self) -> list[int]:
        """Key frames that have to be looked at before this frame is settled."""
        return [key for key in self.keys if self.known[key] is None and key != self.frame]

    def look_ahead(self, keys: list[int], move_to: Callable[[int], set[str]], fitted: Callable[[], Framing]) -> None:
        """Find out what these key frames are fitted to by themselves.

        move_to: evaluates the scene at a frame and says what is not as it was; fitted: fits the scene as it is then.
        """
        framing = None
        for i, key in enumerate(keys):
            with progress.part(i / len(keys), (i + 1) / len(keys)):
                progress.report()
                if move_to(key):
                    framing = fitted()
                self.known[key] = framing

    def settled(self, own: Framing) -> Framing:
        """What the frame is fitted to: what a key frame is, or `own`."""
        self.own = own
        if not self.keys:
            return own
        first, *block = (self.known[key] or own for key in self.keys)
        held = block[0] if block and has_left(first.box, block[0].box) else first
        return own if has_left(held.box, own.box, WITHIN) else held

    def remember(self) -> None:
        """For other frames, now that the shares of this one are known too."""
        _fitted.update({(*self.rendered, key): self.known[key] or self.own for key in self.keys})


def has_left(kept: np.ndarray, box: np.ndarray, tolerance: float = 1.0) -> bool:
    """Whether a picture that would be fitted to `box` (2, 3) is too far from the one that is kept."""
    size, new = (float((b[1] - b[0]).max()) for b in (kept, box))
    apart = np.abs(box.sum(axis=0) - kept.sum(axis=0)).max() / 2
    zoom = LARGEST_ZOOM * tolerance
    return not size / zoom <= new <= size * zoom or apart > FARTHEST * tolerance * size


def _keys(scene: bpy.types.Scene, frame: float) -> tuple[int, ...]:
    switched = [marker.frame for marker in scene.timeline_markers if marker.camera and marker.frame <= frame]
    begin = _begins.get(scene.name, scene.frame_start)
    first = max([begin if bpy.app.background else min(scene.frame_start, begin), *switched])
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
