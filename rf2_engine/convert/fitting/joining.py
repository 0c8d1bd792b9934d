# SPDX-License-Identifier: GPL-3.0-or-later
"""Join parts for which Max Triangles has no room: the tokens of a few joined ones stand for all, and rays meet all."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..data.collected import Part
from ..data.copied import Instance
from ..data.mesh import TriangleMesh, joined, transform

Piece = tuple[Part, Instance]


def join_parts(parts: list[Part], most: int) -> tuple[list[Part], list[Part]]:
    """At most `most` parts of one instance, in the frame of the world, with the surfaces of parts that do not shine.

    And those for which there is no room even so.

    Those with the same materials become one, but where there are more of such than `most`, the smallest are one of
    several materials. What rays, cameras or lights tell apart is not joined. Object and Generated coordinates become
    those of the world.
    """
    groups: dict[tuple, list[Piece]] = {}
    for part in parts:
        for instance in part.instances:
            groups.setdefault((_kind(part, instance), tuple(map(id, part.materials))), []).append((part, instance))
    largest_first = sorted(groups.items(), key=lambda group: -_area(group[1]))
    largest = {kind: pieces for (kind, _), pieces in reversed(largest_first)}  # of each kind
    others = [(kind, pieces) for (kind, _), pieces in largest_first if pieces is not largest[kind]]
    chosen = [*largest.items(), *others][:most]
    smallest, lost = dict(chosen), []  # of each kind, of those that were chosen
    for kind, pieces in [*largest.items(), *others][most:]:
        if kind in smallest:
            smallest[kind] += pieces
        else:
            lost += [part for part, _ in pieces]
    return [_joined(pieces) for _, pieces in chosen], lost


def _kind(part: Part, instance: Instance) -> tuple:
    return part.is_shown, part.hidden, part.blockers, instance.group, instance.is_holdout


def _area(pieces: list[Piece]) -> float:
    return sum(part.mesh.area * abs(np.linalg.det(instance.matrix[:3, :3])) ** (2 / 3) for part, instance in pieces)


def _joined(pieces: list[Piece]) -> Part:
    """One part of several instances of others."""
    first, instance = pieces[0]
    materials = list({id(material): material for part, _ in pieces for material in part.materials}.values())
    real = None
    if any(part.real is not None for part, _ in pieces):
        real = _joined_mesh(pieces, materials, is_real=True)
    name = first.name if len(pieces) == 1 else f"{first.name} and {len(pieces) - 1} more"
    return replace(first, name=name, mesh=_joined_mesh(pieces, materials), materials=materials, real=real,
                   is_textured=any(part.is_textured for part, _ in pieces),
                   instances=[replace(instance, matrix=np.eye(4), name=name, real_matrices=())])


def _joined_mesh(pieces: list[Piece], materials: list, is_real: bool = False) -> TriangleMesh:
    """The meshes of instances, or what rays meet of them, as one in the frame of the world."""
    row, placed = {id(material): i for i, material in enumerate(materials)}, []
    for part, instance in pieces:
        mesh = part.real if is_real and part.real is not None else part.mesh
        corners, normals = transform(mesh, instance.matrix)
        slot = np.array([row[id(material)] for material in part.materials], np.int32)[mesh.slot]
        placed.append(replace(mesh, corners=corners, normals=normals, slot=slot))
    mesh = joined(placed)
    return replace(mesh, texture_space=np.stack([mesh.bounds.mean(0), np.ptp(mesh.bounds, 0) / 2]))
