# SPDX-License-Identifier: GPL-3.0-or-later
"""What has changed in a scene since it was copied."""
from __future__ import annotations

from dataclasses import dataclass, field

import bpy

from ..convert.copying.cache import CopyCache

CAMERA = {"CAMERA"}
OF_WORLDS = bpy.types.World, bpy.types.Image, bpy.types.Texture


@dataclass
class Changes:
    """Nothing, or something that makes a copy out of date; then also what has to be read again."""

    everything: bool = False
    anything: bool = False
    geometry: set[int] = field(default_factory=set)  # session_uids of objects
    images: set[int] = field(default_factory=set)    # and of images
    world: bool = False                              # or what its nodes refer to

    def add(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Add the changes of its last evaluation. Cameras are ignored: they are read for every picture."""
        for update in depsgraph.updates:
            block = update.id
            if isinstance(block, bpy.types.Camera) or isinstance(block, bpy.types.Object) and block.type in CAMERA:
                continue
            self.anything = True
            if isinstance(block, bpy.types.Object) and update.is_updated_geometry:
                self.geometry.add(block.original.session_uid)
            elif isinstance(block, bpy.types.Image):
                self.images.add(block.session_uid)
            if isinstance(block, OF_WORLDS) or isinstance(block, bpy.types.NodeTree) and not block.is_embedded_data:
                self.world = True

    def add_everything(self) -> None:
        self.everything = self.anything = True

    def drop_from(self, cache: CopyCache) -> CopyCache:
        """What still holds of what was read."""
        if self.everything:
            return CopyCache()
        cache.drop(self.geometry, self.images)
        if self.world:
            cache.world = None
        return cache
