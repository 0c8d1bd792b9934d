# SPDX-License-Identifier: GPL-3.0-or-later
"""What was read from Blender and holds until it is edited, for whoever copies a scene again and again."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from ..data.blocks import World
from ..data.mesh import TriangleMesh
from ..data.report import Remark, Report
from .meshes import read_mesh


@dataclass
class _Mesh:
    owner: int  # session_uid of the object that it was read from
    triangles: TriangleMesh
    remarks: list[Remark]


class Meshes:
    """Evaluated meshes by the objects that wear them."""

    def __init__(self) -> None:
        self._known: dict[tuple, _Mesh] = {}
        self._used: set[tuple] = set()

    def of(self, obj, asked: set[str], report) -> TriangleMesh:
        """The mesh of an evaluated object, read unless that was done before; asked, report: as read_mesh has them."""
        mesh, owner = obj.data, obj.original.session_uid
        key = owner, mesh.as_pointer(), len(mesh.vertices), len(mesh.loops), obj.name, *sorted(asked)
        self._used.add(key)
        if key not in self._known or mesh.is_editmode:  # the lengths above are 0 then
            own = Report()
            self._known[key] = _Mesh(owner, _read(obj, own, asked), own.entries)
        report.add(self._known[key].remarks)
        return self._known[key].triangles

    def drop(self, owners: set[int]) -> None:
        """Those of objects with these session_uids, which have changed."""
        self._known = {key: mesh for key, mesh in self._known.items() if mesh.owner not in owners}

    def drop_unused(self) -> None:
        """Those that nobody has asked for since this was called last."""
        self._known = {key: mesh for key, mesh in self._known.items() if key in self._used}
        self._used = set()

    def __len__(self) -> int:
        return len(self._known)


def _read(obj, report, asked: set[str]) -> TriangleMesh:
    """The mesh of an evaluated object. In Edit Mode nothing is in it before Blender is asked for one."""
    if not obj.data.is_editmode:
        return read_mesh(obj.data, obj.name, report, asked)
    try:
        return read_mesh(obj.to_mesh(), obj.name, report, asked)
    finally:
        obj.to_mesh_clear()


@dataclass
class Kept:
    meshes: Meshes = field(default_factory=Meshes)
    images: dict[tuple, tuple] = field(default_factory=dict)  # as Images knows them
    world: tuple[tuple, World] | None = None                  # and what it is known by

    def __len__(self) -> int:
        """How much was read: grows with each mesh and image."""
        return len(self.meshes) + len(self.images)

    def world_of(self, block, frame: int, read: Callable[[], World | None]) -> World | None:
        """The copy of a world, of which `read` makes one; of another frame where it has images, which may be movies."""
        if block is None:
            return None
        if self.world is None or self.world[0] not in ((block.session_uid, None), (block.session_uid, frame)):
            world = read()
            self.world = (block.session_uid, frame if world.widths or world.has_groups else None), world
        return self.world[1]

    def drop(self, owners: set[int], images: set[int]) -> None:
        """What was read of these objects and images (session_uids), because it has changed."""
        self.meshes.drop(owners)
        for key in [key for key in self.images if key[0] in images]:
            del self.images[key]
