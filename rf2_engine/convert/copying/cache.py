# SPDX-License-Identifier: GPL-3.0-or-later
"""What was read from Blender and is valid until it is edited, for scenes that are copied again and again."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from ..data.blocks import World
from ..data.mesh import TriangleMesh
from ..data.report import Remark, Report
from .meshes import read_mesh
from .strands import Strands


@dataclass
class _Entry:
    owner: int  # session_uid of the object that it was read from
    value: TriangleMesh | Strands
    remarks: list[Remark]


class MeshCache:
    """Evaluated meshes, hair and points by their objects."""

    def __init__(self) -> None:
        self._entries: dict[tuple, _Entry] = {}
        self._used: set[tuple] = set()

    def of(self, obj, requested: set[str], report: Report) -> TriangleMesh:
        """The mesh of an evaluated object, read unless it is in the cache; arguments as of read_mesh."""
        mesh, owner = obj.data, obj.original.session_uid
        key = owner, mesh.as_pointer(), len(mesh.vertices), len(mesh.loops), obj.name, *sorted(requested)
        if mesh.is_editmode:  # the lengths above are 0 then
            self._entries.pop(key, None)
        return self._get(key, owner, lambda own: _read(obj, own, requested), report)

    def strands_of(self, obj, pointer: int, read: Callable[[Report, set[str]], Strands], requested: set[str],
                   report: Report) -> Strands:
        """Hair or points of an evaluated object, known by a pointer, which `read` gives unless they are in the cache.
        """
        owner = obj.original.session_uid
        key = owner, pointer, obj.name, *sorted(requested)
        return self._get(key, owner, lambda own: read(own, requested), report)

    def _get(self, key: tuple, owner: int, read: Callable[[Report], TriangleMesh | Strands], report: Report):
        self._used.add(key)
        if key not in self._entries:
            own = Report()
            self._entries[key] = _Entry(owner, read(own), own.entries)
        report.add(self._entries[key].remarks)
        return self._entries[key].value

    def drop(self, owners: set[int]) -> None:
        """Forget what belongs to objects with these session_uids, which have changed."""
        self._entries = {key: entry for key, entry in self._entries.items() if entry.owner not in owners}

    def drop_unused(self) -> None:
        """Forget what was not used since the last call."""
        self._entries = {key: entry for key, entry in self._entries.items() if key in self._used}
        self._used = set()

    def __len__(self) -> int:
        return len(self._entries)


def _read(obj, report: Report, requested: set[str]) -> TriangleMesh:
    """The mesh of an evaluated object. In Edit Mode it is empty before Blender makes one."""
    if not obj.data.is_editmode:
        return read_mesh(obj.data, obj.name, report, requested)
    try:
        return read_mesh(obj.to_mesh(), obj.name, report, requested)
    finally:
        obj.to_mesh_clear()


@dataclass
class CopyCache:
    meshes: MeshCache = field(default_factory=MeshCache)
    images: dict[tuple, tuple] = field(default_factory=dict)  # as in Images
    world: tuple[tuple, World] | None = None                  # and what it is known by

    def __len__(self) -> int:
        """How much was read: grows with each mesh and image."""
        return len(self.meshes) + len(self.images)

    def of_meshes(self) -> CopyCache:
        """The meshes alone, shared, for a copy whose images are not read."""
        return CopyCache(self.meshes)

    def world_of(self, block, frame: int, read: Callable[[], World | None]) -> World | None:
        """The copy of a world, made by `read` once, or once a frame where it has images, which may be movies."""
        if block is None:
            return None
        if self.world is None or self.world[0] not in ((block.session_uid, None), (block.session_uid, frame)):
            world = read()
            self.world = (block.session_uid, frame if world.widths or world.has_groups else None), world
        return self.world[1]

    def drop(self, owners: set[int], images: set[int]) -> None:
        """Forget objects and images (session_uids) that have changed."""
        self.meshes.drop(owners)
        for key in [key for key in self.images if key[0] in images]:
            del self.images[key]
