# SPDX-License-Identifier: GPL-3.0-or-later
"""Displace the mesh itself, if the displacement is more than the tiles' heights can store, or the mesh is diced."""
from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..data import mesh as meshes
from ..data.copied import Instance
from ..data.mesh import TriangleMesh
from ..data.report import Report
from ..shading import graph
from ..shading.evaluate import Evaluator
from ..shading.material import HEIGHT_UNIT
from ..shading.node_call import NodeCall, Unknown
from ..shading.points import Points
from .subdivide import pieces, subdivide

DICED = 1 << 14      # triangles of a diced mesh, before it is simplified to the budget
FLAT = 1e-3          # normals that differ by less are one


@dataclass
class CornerPoints(Points):
    """The corners of triangles, one after the other: values are (3 m, c)."""

    @property
    def position(self) -> np.ndarray:
        return self.corners.reshape(-1, 3)

    @property
    def normal(self) -> np.ndarray:
        return self.normals.reshape(-1, 3)

    @property
    def face_normal(self) -> np.ndarray:
        return np.repeat(meshes.face_normals(self.corners).astype(np.float32), 3, axis=0)

    @property
    def edges(self):
        raise Unknown("a changed normal does not displace")


def displace(mesh: TriangleMesh, slots: list, instance: Instance, is_diced: bool, report: Report) -> TriangleMesh:
    """`mesh` displaced along its normals by its materials, if that is too much for heights of tiles, or it is diced.

    slots: materials. The material's own displacement counts as done then (`is_displaced`).
    """
    movers = [i for i, material in enumerate(slots) if _moves(material)]
    chosen = np.isin(np.clip(mesh.slot, 0, len(slots) - 1), movers)
    if not chosen.any():
        return mesh
    if is_diced:
        mesh = _diced(mesh, chosen)
    slot, offset = np.clip(mesh.slot, 0, len(slots) - 1), np.zeros((len(mesh), 3, 1), np.float32)
    for i in movers:
        part = mesh.take(slot == i)
        offset[slot == i] = _offset(slots[i], part, instance, report)
    if not is_diced and np.abs(offset * _stretch(mesh, instance)).max() <= HEIGHT_UNIT:
        return mesh
    for i in movers:
        report.approximated(slots[i].name, "its displacement moves only the corners of triangles: finer detail is "
                                           "lost")
    moved = mesh.corners + _shared(mesh.corners, offset * mesh.normals)
    return replace(mesh, corners=moved, normals=_normals(mesh, moved, is_diced), is_displaced=True)


def _source(material) -> tuple | None:
    """The node that displaces a material, and the group nodes that lead to it; None if there is none."""
    output = graph.output_node(material.node_tree) if material else None
    socket = output and graph.find_input(output, "Displacement")
    _, source, frames = graph.source(socket) if socket else (None, None, ())
    return None if source is None else (source.node, frames)


def _moves(material) -> bool:
    source = _source(material)
    return (source is not None and source[0].bl_idname == "ShaderNodeDisplacement"
            and material.displacement_method != "BUMP")


def _offset(material, mesh: TriangleMesh, instance: Instance, report: Report) -> np.ndarray:
    """(m, 3, 1) displacement along the normal, in the frame of the object."""
    uv = {name: np.pad(layer.reshape(-1, 2), ((0, 0), (0, 1))) for name, layer in mesh.uv.items()}
    named = {name: layer.reshape(-1, layer.shape[-1]) for name, layer in mesh.attributes.items()}
    points = CornerPoints(uv, mesh.active_uv, named, mesh.active_color, mesh.corners, mesh.texture_space, mesh.normals,
                          instance)
    n = NodeCall(Evaluator(points, material.node_tree.conventions, report, material.name), *_node(material))
    height = np.broadcast_to((n["Height"] - n["Midlevel"]) * n["Scale"], (3 * len(mesh), 1)).reshape(-1, 3, 1)
    height = report.finite(material.name, "its displacement", np.float32(height))
    return height if n.node.space == "OBJECT" else height / np.maximum(_stretch(mesh, instance), 1e-12)


def _node(material) -> tuple:
    node, frames = _source(material)
    return node, node.outputs[0], frames


def _stretch(mesh: TriangleMesh, instance: Instance) -> np.ndarray:
    """(m, 3, 1) how much longer a normal is in the world than in the frame of the object."""
    return np.linalg.norm(mesh.normals @ instance.matrix[:3, :3].T, axis=-1, keepdims=True).astype(np.float32)


def _diced(mesh: TriangleMesh, chosen: np.ndarray) -> TriangleMesh:
    """The chosen triangles divided alike, as far as there is room."""
    edge = np.sqrt(4 * meshes.areas(mesh.corners[chosen]).sum() / DICED)
    return pieces(mesh, *subdivide(mesh.corners, chosen.astype(int), edge, max(DICED - len(mesh), 0)))


def _shared(corners: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """(m, 3, 3) offsets with their mean wherever corners meet, so that nothing tears."""
    _, inverse, count = np.unique(meshes.corner_keys(corners).ravel(), return_inverse=True, return_counts=True)
    flat = offset.reshape(-1, 3)
    mean = np.stack([np.bincount(inverse, flat[:, i]) / count for i in range(3)], axis=-1)
    return mean[inverse].reshape(offset.shape).astype(np.float32)


def _normals(mesh: TriangleMesh, moved: np.ndarray, is_smooth: bool) -> np.ndarray:
    """(m, 3, 3) of the moved corners: of the faces, or means over adjacent faces where the surface was smooth."""
    face = meshes.area_vectors(moved.astype(np.float64))
    _, inverse = np.unique(meshes.corner_keys(mesh.corners).ravel(), return_inverse=True)
    total = np.stack([np.bincount(inverse, np.repeat(face[:, i], 3)) for i in range(3)], axis=-1)[inverse]
    before = meshes.face_normals(mesh.corners)[:, None]
    bent = (np.abs(mesh.normals - before) > FLAT).any(axis=(1, 2), keepdims=True)
    flat = np.repeat(meshes.face_normals(moved)[:, None], 3, axis=1)
    return meshes.unit_or(np.where(bent | is_smooth, total.reshape(-1, 3, 3), flat), flat)
