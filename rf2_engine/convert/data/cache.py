# SPDX-License-Identifier: GPL-3.0-or-later
"""Results of a conversion that the next one of an edited scene can use again."""
from __future__ import annotations

import hashlib
from collections.abc import Callable

import numpy as np

from .mesh import TriangleMesh
from .report import Remark, Report


class ConversionCache:
    """Results by their inputs, with the remarks that were made. What a conversion did not use is forgotten."""

    def __init__(self) -> None:
        self._entries: dict[tuple, tuple[object, list[Remark]]] = {}
        self._used: dict[tuple, tuple[object, list[Remark]]] = {}

    def get(self, key: tuple, compute: Callable[[Report], object], report: Report):
        """compute(report), or the earlier result for the same key."""
        entry = self._entries.get(key) or self._used.get(key)
        if entry is None:
            own = Report()
            entry = compute(own), own.entries
        self._used[key] = entry
        report.add(entry[1])
        return entry[0]

    def begin(self) -> None:
        """Another conversion begins. A cancelled one leaves what it has computed."""
        self._entries |= self._used
        self._used = {}

    def end(self) -> None:
        self._entries, self._used = self._used, {}


def mesh_digest(mesh: TriangleMesh) -> bytes:
    """The same for meshes with equal triangles."""
    digest = hashlib.blake2b(digest_size=16)
    layers = {"corners": mesh.corners, "normals": mesh.normals, "slot": mesh.slot, "space": mesh.texture_space,
              **{f"uv {name}": layer for name, layer in mesh.uv.items()},
              **{f"attribute {name}": layer for name, layer in mesh.attributes.items()}}
    for name, values in layers.items():
        digest.update(f"{name}{values.shape}{values.dtype}".encode())
        digest.update(np.ascontiguousarray(values))
    digest.update(repr((mesh.active_uv, mesh.active_color, mesh.is_displaced)).encode())
    return digest.digest()
