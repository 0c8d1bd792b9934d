# SPDX-License-Identifier: GPL-3.0-or-later
"""Wavefront OBJ as the research code uses it: world coordinates, a UV and a normal per corner, no materials."""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import SceneError


@dataclass
class ObjMesh:
    """F polygons with C corners in all; corners at the same position share a vertex."""

    vertices: np.ndarray        # (V, 3) f32
    corner_vertex: np.ndarray   # (C,) i32
    sizes: np.ndarray           # (F,) i32, corners of each polygon
    uv: np.ndarray | None       # (C, 2) f32
    normals: np.ndarray | None  # (C, 3) f32


def read_obj(path: Path) -> ObjMesh:
    """Raises SceneError naming the file and the line that cannot be understood, OSError as the disk does."""
    lists: dict[str, list] = {"v": [], "vt": [], "vn": []}
    corners: list[tuple[int, int, int]] = []
    sizes: list[int] = []
    with open(path, encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, 1):
            kind, *words = line.split() or [""]
            try:
                if kind in lists:
                    lists[kind].append([float(word) for word in words[:2 if kind == "vt" else 3]])
                elif kind == "f":
                    corners += [_corner(word, lists) for word in words]
                    sizes.append(len(words))
            except (ValueError, IndexError) as error:
                raise SceneError(f"{path}, line {number}: {line.strip()[:60]!r} cannot be understood ({error})"
                                 ) from error
    try:
        return _mesh(lists, np.array(corners, np.int32).reshape(-1, 3), np.array(sizes, np.int32))
    except (ValueError, IndexError) as error:
        raise SceneError(f"{path}: its vertices and faces do not fit together ({error}): export it again") from error


def _corner(word: str, lists: dict[str, list]) -> tuple[int, int, int]:
    """Indices into the lists, -1 for none; the file counts from 1, or backwards from the latest."""
    indices = []
    for text, rows in zip((word + "//").split("/"), lists.values()):
        index = int(text) if text else 0
        indices.append(index - 1 if index > 0 else len(rows) + index if index < 0 else -1)
    if indices[0] < 0:
        raise ValueError("a corner without vertex")
    return tuple(indices)


def _mesh(lists: dict[str, list], corners: np.ndarray, sizes: np.ndarray) -> ObjMesh:
    position = np.array(lists["v"], np.float32).reshape(-1, 3)
    vertices, same = np.unique(position, axis=0, return_inverse=True)
    vertex = same.reshape(-1)[corners[:, 0]].astype(np.int32)
    face = np.repeat(np.arange(len(sizes)), sizes)
    # A face that meets itself in a vertex has no area there.
    pairs = np.unique(np.stack([face, vertex], 1), axis=0, return_counts=True)
    is_valid = np.ones(len(sizes), bool)
    is_valid[pairs[0][pairs[1] > 1, 0]] = False
    is_valid &= sizes > 2
    at = is_valid[face]
    uv = np.array(lists["vt"], np.float32).reshape(-1, 2)[corners[at, 1]] if (corners[:, 1] >= 0).all() else None
    normals = np.array(lists["vn"], np.float32).reshape(-1, 3)[corners[at, 2]] if (corners[:, 2] >= 0).all() else None
    return ObjMesh(vertices, vertex[at], sizes[is_valid], uv if len(lists["vt"]) else None,
                   normals if len(lists["vn"]) else None)


def write_obj(path: Path, corners: np.ndarray, normals: np.ndarray | None, uv: np.ndarray | None) -> None:
    """Triangles (n, 3, 3) with unit normals (n, 3, 3) and UVs (n, 3, 2), each with three vertices of its own.

    Raises OSError as the disk does.
    """
    columns = {"v": corners, "vt": uv, "vn": normals}
    rows = [(kind, values.reshape(-1, values.shape[-1])) for kind, values in columns.items() if values is not None]
    pattern = "/".join("" if values is None else "{0}" for values in columns.values()).rstrip("/")
    with open(path, "w", encoding="utf-8", newline="\n") as file:
        for kind, values in rows:
            line = f"{kind} " + " ".join(["%.9g"] * values.shape[1]) + "\n"
            file.writelines(line % tuple(row) for row in values.tolist())
        for i in range(1, 3 * len(corners), 3):
            file.write("f " + " ".join(pattern.format(i + j) for j in range(3)) + "\n")
