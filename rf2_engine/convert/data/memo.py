# SPDX-License-Identifier: GPL-3.0-or-later
"""Results of a conversion that the next one of an edited scene can use again."""
from __future__ import annotations

import hashlib
from collections.abc import Callable

import numpy as np

from .mesh import TriangleMesh
from .report import Remark, Report


class Memo:
    """By what they were computed from, with the remarks that were made. What a conversion did not use is forgotten."""

    def __init__(self) -> None:
        self._known: dict[tuple, tuple[object, list[Remark]]] = {}
        self._used: dict[tuple, tuple[object, list[Remark]]] = {}

    def of(self, key: tuple, compute: Callable[[Report], object], report: Report):
        """compute(report), or what that gave before for the same key."""
        found = self._known.get(key) or self._used.get(key)
        if found is None:
            own = Report()
            found = compute(own), own.entries
        self._used[key] = found
        report.add(found[1])
        return found[0]

    def begin(self) -> None:
        """Another conversion begins. One that was cancelled leaves what it has computed."""
        self._known |= self._used
        self._used = {}

    def end(self) -> None:
        self._known, self._used = self._used, {}


def content(mesh: TriangleMesh) -> bytes:
    """The same for meshes with the same triangles."""
    digest = hashlib.blake2b(digest_size=16)
    layers = {"corners": mesh.corners, "normals": mesh.normals, "slot": mesh.slot, "space": mesh.texture_space,
              **{f"uv {name}": layer for name, layer in mesh.uv.items()},
              **{f"attribute {name}": layer for name, layer in mesh.attributes.items()}}
    for name, values in layers.items():
        digest.update(f"{name}{values.shape}{values.dtype}".encode())
        digest.update(np.ascontiguousarray(values))
    digest.update(repr((mesh.active_uv, mesh.active_color, mesh.is_displaced)).encode())
    return digest.digest()
