# SPDX-License-Identifier: GPL-3.0-or-later
"""Set properties of evaluated data for a run of Cycles, and put them back."""
from __future__ import annotations

from contextlib import contextmanager

import bpy

from . import background as background_cycles
from .evaluated_scene import restore_objects, survives


class Overrides:
    """The function that sets properties, and what it has set."""

    def __init__(self) -> None:
        self.changes = []  # as background_cycles.describe_change returns them
        self._saved = []

    def __call__(self, data: bpy.types.ID, settings: dict[str, object]) -> None:
        """Set properties of evaluated data, given by dotted path."""
        for path, value in settings.items():
            owner, name = _owner(data, path)
            if hasattr(owner, name):  # Cycles' settings come and go with Blender's version
                self._saved.append((data, path, _copy(getattr(owner, name))))
                setattr(owner, name, value)
                self.changes.append(background_cycles.describe_change(data, path, value))

    def restore(self) -> None:
        for data, path, value in reversed(self._saved):
            owner, name = _owner(data, path)  # motion blur evaluates the scene anew, which moves what is in it
            setattr(owner, name, value)


@contextmanager
def overrides(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph):
    """Give an Overrides that sets properties of evaluated data; in the end they are put back.

    The user's scene never sees it: it is the evaluated copy that Cycles reads.
    """
    restore_objects(engine, depsgraph)  # now, for it undoes whatever is set
    override, is_kept = Overrides(), survives(engine, depsgraph)
    try:
        yield override
    finally:
        if is_kept:
            override.restore()


def _copy(value):
    if isinstance(value, bpy.types.bpy_prop_array):
        return tuple(value)
    return value.copy() if hasattr(value, "copy") else value


def _owner(data: bpy.types.ID, path: str) -> tuple[bpy.types.bpy_struct, str]:
    parent, _, name = path.rpartition(".")
    return data.path_resolve(parent) if parent else data, name
