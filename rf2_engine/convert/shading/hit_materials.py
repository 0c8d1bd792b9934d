# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials where rays of the camera hit the real surfaces, evaluated there instead of read from tiles of tokens."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ....model.compute.threads import spread
from ....model.first_hits.at_pixels import Appearance
from ....model.scene import PARAMETERS, Geometry, constant_tile
from ....model.surface_kinds import Ray
from ..data.blocks import Material
from ..data.collected import Part
from ..data.copied import Instance
from ..data.mesh import TriangleMesh
from ..data.report import Report
from . import graph
from .material import evaluate_material
from .material_tiles import MaterialTiles
from .normal_map import UP, bent_normals
from .points import surface_points
from .tile_arrays import bsdf_parameters

CHUNK = 1 << 13       # pixels evaluated at once
MOST = 256            # materials in a picture that are evaluated; those that fill least of it are read from tiles
TILED = -1            # instead of a group, where the tile of the token is exact
FINITE = 1e4          # radiance that a pixel shows at most where a node divides by 0
BY_PIXEL = "ShaderNodeTexImage", "ShaderNodeTexChecker"  # nodes that need the size of a pixel
DEFAULT = constant_tile()[PARAMETERS, 0, 0].astype(np.float32)


@dataclass(frozen=True)
class _Group:
    """Triangles of a mesh with one material that look the same in all its instances here."""

    mesh: TriangleMesh
    material: Material | None
    instance: Instance


class HitMaterials:
    """The materials of a scene's geometry, which `at` evaluates (the protocol of model/first_hits/at_pixels.py).

    Materials that are the same all over need no evaluation: the tiles of their tokens are exact.
    """

    def __init__(self) -> None:
        self.geometry: Geometry | None = None  # of the scene, whose first rows were added
        self._groups: list[_Group] = []
        self._by_key: dict[tuple, int] = {}
        self._group_of_rows: list[np.ndarray] = []
        self._triangle_of_rows: list[np.ndarray] = []

    def add(self, part: Part, instance: Instance, tiles: MaterialTiles, is_kept: np.ndarray) -> None:
        """The next rows of the geometry are these triangles (n,) of the real mesh of an instance."""
        mesh = part.mesh if part.real is None else part.real
        varying = [self._group(part, mesh, slot, instance, tiles) if tiles.varies(material) else TILED
                   for slot, material in enumerate(part.materials)]
        group = np.array(varying, np.int32)[mesh.slot]
        if part.real is not None:  # the token of another material stands for the last triangles of one
            for slot in np.unique(mesh.slot[(part.mesh.slot[part.token] != mesh.slot) & (group == TILED)]):
                foreign = (mesh.slot == slot) & (part.mesh.slot[part.token] != slot)
                group[foreign] = self._group(part, mesh, slot, instance, tiles)
        self._group_of_rows.append(group[is_kept])
        self._triangle_of_rows.append(np.flatnonzero(is_kept).astype(np.int32))

    def _group(self, part: Part, mesh: TriangleMesh, slot: int, instance: Instance, tiles: MaterialTiles) -> int:
        material = part.materials[slot]
        key = id(part), int(slot), tiles.sharing(material, instance)
        if key not in self._by_key:
            self._by_key[key] = len(self._groups)
            self._groups.append(_Group(mesh, material, instance))
        return self._by_key[key]

    def groups(self, triangle: np.ndarray) -> np.ndarray | None:
        """(P,) i32 numbers of materials to be evaluated on triangles (P,) of the geometry, -1 for none and for -1;
        None if there are none at all."""
        if not self._groups:
            return None
        group = _join(self._group_of_rows)
        return np.where((triangle >= 0) & (triangle < len(group)), group[triangle.clip(0, len(group) - 1)], TILED)

    def at(self, triangle: np.ndarray, weights: np.ndarray, normal: np.ndarray,
           steps: Callable[[np.ndarray], np.ndarray]) -> Appearance:
        """The appearance of points; see Materials."""
        group, on_mesh = _join(self._group_of_rows)[triangle], _join(self._triangle_of_rows)[triangle]
        corners, result = self.geometry.triangles, Appearance.empty(normal)
        order = np.argsort(group, kind="stable")
        kinds, first, count = np.unique(group[order], return_index=True, return_counts=True)
        pieces = [(kinds[i], order[begin:min(begin + CHUNK, first[i] + count[i])])
                  for i in np.argsort(-count, kind="stable")[:MOST]
                  for begin in range(first[i], first[i] + count[i], CHUNK)]

        def evaluate(number: int, rows: np.ndarray) -> None:
            part = _evaluated(self._groups[number], on_mesh[rows], weights[rows], normal[rows],
                              corners[triangle[rows]], lambda: steps(rows))
            for whole, values in zip(result, part, strict=True):
                whole[rows] = values

        spread(evaluate, pieces)
        return result


def _join(arrays: list[np.ndarray]) -> np.ndarray:
    """Arrays (n,) i32 as one, which takes their place in the list."""
    if len(arrays) != 1:
        arrays[:] = [np.concatenate([np.zeros(0, np.int32), *arrays])]
    return arrays[0]


def _evaluated(group: _Group, on_mesh: np.ndarray, weights: np.ndarray, normal: np.ndarray, corners: np.ndarray,
               find_steps: Callable[[], np.ndarray]) -> Appearance:
    """The appearance of points on triangles (P,) of the mesh of a group, whose corners in the world are (P, 3, 3)."""
    is_known = np.ones(len(on_mesh), bool)
    if group.material is None:
        return Appearance(is_known, np.tile(DEFAULT, (len(on_mesh), 1)), np.zeros_like(normal), normal)
    needs_neighbours, bends = _needs(group.material)
    grid = weights[:, None, None]
    if needs_neighbours:
        right, below = np.moveaxis(find_steps()[:, :, None, None], 1, 0)
        grid = np.concatenate([grid, grid + right], axis=2)
        grid = np.concatenate([grid, grid + below], axis=1)
    points = surface_points(group.mesh, group.instance, on_mesh, grid, first_alone=not bends, ray=Ray.CAMERA)
    surface = evaluate_material(group.material, points, Report()).surface
    texel = np.empty((len(on_mesh), len(DEFAULT)), np.float32)
    for channels, values in bsdf_parameters(surface):
        texel[:, channels] = _first(values) if isinstance(channels, slice) else _first(values)[..., 0]
    if needs_neighbours and (surface.normal.ndim > 1 or (surface.normal != UP).any()):
        bent = np.broadcast_to(_first(surface.normal), normal.shape)
        normal = bent_normals(bent, points, corners, normal)
    emission = np.broadcast_to(_first(surface.emission).clip(0, FINITE), normal.shape)
    return Appearance(is_known, texel, emission, normal)


def _first(values: np.ndarray) -> np.ndarray:
    """(P, c) or (c,) values at the first point of each triangle."""
    return np.nan_to_num(values[:, 0, 0] if values.ndim > 1 else values)


def _needs(material: Material) -> tuple[bool, bool]:
    """Whether a material needs neighbouring points, and whether it needs the values of all nodes there."""
    tree = material.node_tree
    if tree is None or tree.output is None:
        return False, False
    nodes = list(tree.all_nodes())
    displacement = graph.find_input(tree.output, "Displacement")
    bends = any(node.bl_idname == "ShaderNodeBump" for node in nodes) or (
        material.displacement_method == "BUMP" and graph.source(displacement)[1] is not None)
    return bends or any(node.bl_idname in BY_PIXEL or any(
        socket.name == "Normal" and socket.is_linked for socket in node.inputs) for node in nodes), bends
