# SPDX-License-Identifier: GPL-3.0-or-later
"""A view layer as viewports show it: copied from Blender in slices, and again after each change."""
from __future__ import annotations

import itertools
import time
from collections.abc import Callable
from weakref import WeakSet

import bpy

from ...model import progress
from ..convert.copying.cache import CopyCache
from ..convert.copying.scene import copy
from ..convert.data.copied import CopiedScene
from ..convert.data.report import Report
from ..runtime import failure
from .changes import Changes

SLICE = 0.05  # seconds that Blender's window waits for us at a time, unless one mesh or image takes longer
EAGER = 4     # times as long while there is nothing to see: between two slices the window is drawn

Key = tuple
State = tuple[int, int]

_numbers = itertools.count()


class _SliceOver(Exception):
    pass


class Source:
    """What viewports of the same scene, view layer and local view share."""

    def __init__(self) -> None:
        self.changes = Changes(everything=True, anything=True)
        self.copied: CopiedScene | None = None
        self.bare: CopiedScene | None = None  # of a large scene, before its images are read for the first copy
        self.updated = WeakSet()        # viewports that Blender has updated since changes were noted last
        self._noted: set[tuple] = set()  # those changes
        self.version = 0                # of the copy; 0: none yet
        self.error = ""                 # why it could not be copied
        self._cache = CopyCache()
        self._number = next(_numbers)

    def note(self, depsgraph: bpy.types.Depsgraph) -> None:
        """The changes of its last evaluation."""
        self.changes.add(depsgraph)
        self._noted = _keys(depsgraph)
        self.updated.clear()

    def has_noted(self, depsgraph: bpy.types.Depsgraph, viewport) -> bool:
        """Whether its last changes are those noted last, of which `viewport` has not been told yet."""
        return viewport not in self.updated and _keys(depsgraph) <= self._noted

    @property
    def state(self) -> State:
        """Which copy `copied` is, of all copies of all sources."""
        return self._number, self.version

    @property
    def newest(self) -> CopiedScene | None:
        """What can be shown."""
        return self.copied or self.bare

    def refresh(self, depsgraph: bpy.types.Depsgraph, hides: Callable | None = None) -> bool:
        """Copy what has changed, on Blender's main thread; False if another slice is needed. What fails is tried again
        after the next change.

        hides: says of an original object that the viewport does not show it.
        """
        if not self.changes.anything:
            return True
        self._cache = self.changes.drop_from(self._cache)
        self.changes = Changes(anything=True)
        begin, read = time.perf_counter(), len(self._cache)
        is_bare = not self.version and self.bare is None and read > 0  # one slice was not enough
        cache, limit = self._cache.of_meshes() if is_bare else self._cache, SLICE * (1 if self.newest else EAGER)

        def listen(*_) -> None:
            if time.perf_counter() - begin > limit and len(self._cache) > read:
                raise _SliceOver()

        try:
            with progress.reporting(listen):
                copied = copy(depsgraph, Report(), cache=cache, hides=hides or (lambda obj: False),
                              reads_images=not is_bare)
        except _SliceOver:
            return False
        except Exception as error:
            self.error, self.changes, self.bare = failure.message(error), Changes(), None
            return True
        if is_bare:
            self.bare = copied
            return False
        self.changes = Changes()
        self.copied, self.bare, self.error, self.version = copied, None, "", self.version + 1
        return True


def _keys(depsgraph: bpy.types.Depsgraph) -> set[tuple]:
    return {(update.id.session_uid, update.is_updated_geometry, update.is_updated_transform, update.is_updated_shading)
            for update in depsgraph.updates}


def source_key(depsgraph: bpy.types.Depsgraph, space: bpy.types.SpaceView3D | None = None) -> Key:
    """What a source is known by; `space` counts where a viewport hides objects of its own."""
    key = depsgraph.scene.session_uid, depsgraph.view_layer.name
    if space is None:
        return key
    kinds = tuple(prop.identifier for prop in space.bl_rna.properties
                  if prop.identifier.startswith("show_object_viewport_") and not getattr(space, prop.identifier))
    if not (kinds or space.local_view or space.use_local_collections):
        return key
    return *key, space.as_pointer(), bool(space.local_view), space.use_local_collections, kinds


def hides_in(space: bpy.types.SpaceView3D) -> Callable:
    """Says of an original object that this viewport does not show it: local view, local collections, object types."""
    return lambda obj: not obj.visible_in_viewport_get(space)
