# SPDX-License-Identifier: GPL-3.0-or-later
"""Divide the copied scene into parts that emit light, parts that do not, and media; displace them."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...model import progress
from .data.blocks import Material
from .data.collected import Collected, Part
from .data.copied import Copied, Gridded, Surface
from .data.instance import Place
from .data.mesh import TriangleMesh
from .data.report import Report
from .media.volumes import MeshVolume, gridded
from .meshes.displace import displaced
from .shading import volume as shading
from .shading.material import MaterialTiles

PROBES = 16  # triangles that tell whether a material emits
UNIT_SQUARE = np.array([[(0, 0), (1, 0), (0, 1)], [(1, 1), (0, 1), (1, 0)]], np.float32)  # UV of two triangles


def collect(copied: Copied, report) -> Collected:
    """Each mesh displaced and divided once for all its instances that look alike."""
    return _Collection(report).of(copied)


class _Collection:
    def __init__(self, report):
        self.report = report
        self.found = Collected()
        self._displaced: dict[tuple, TriangleMesh] = {}
        self._parts: dict[tuple, tuple[list[Part], list[MeshVolume]]] = {}
        self._homogeneous: dict[tuple, bool] = {}  # material and layers of meshes -> it emits
        self._probed: dict[tuple, tuple[bool, bool]] = {}  # by mesh and material, where all instances are alike

    def of(self, copied: Copied) -> Collected:
        self.found.lamps = copied.lamps
        total = len(copied.things)
        for i, thing in enumerate(copied.things):
            with progress.part(i / total, (i + 1) / total, f"Preparing objects, {i + 1} of {total}"):
                progress.report()
                if isinstance(thing, Gridded):
                    self.found.media.append(gridded(thing, self.report))
                elif thing[0].strands_slot is not None:
                    self._add_strands(*thing)
                else:
                    self._add_mesh(*thing)
        return self.found

    def _add_mesh(self, surface: Surface, place: Place) -> None:
        mesh = self._mesh(surface, place)
        probed = tuple(self._probe(material, surface.source, mesh, place) for material in surface.slots)
        key = surface, probed
        if key not in self._parts:
            self._parts[key] = self._split(surface, mesh, probed, place.name), self._filled(surface, mesh, place.name)
            self.found.parts += self._parts[key][0]
        parts, filled = self._parts[key]
        for part in parts:
            part.places.append(place)
        if np.linalg.det(place.matrix[:3, :3]):  # a flat one is no medium
            self.found.media += [volume.at(place) for volume in filled]

    def _filled(self, surface: Surface, mesh: TriangleMesh, name: str) -> list[MeshVolume]:
        """Of each volume material of a mesh what it fills."""
        filled = []
        for index, material in enumerate(surface.slots):
            corners = mesh.corners[_slot(mesh, surface) == index] if shading.has_volume(material) else ()
            if len(corners):
                filled.append(MeshVolume(name, corners, material, mesh.texture_space, self.report))
        return filled

    def _add_strands(self, surface: Surface, place: Place) -> None:
        """Hair or points, which wear one material."""
        if (surface,) not in self._parts:
            mesh, material = surface.mesh, surface.slots[surface.strands_slot]
            emits, textured = self._probe(material, surface.source, mesh, place) if len(mesh) else (False, False)
            parts = [Part(place.name, mesh, [material], emits, surface.is_shown, is_textured=textured,
                          flux_gain=_gain(surface))] if len(mesh) else []
            self._parts[surface,] = parts, []
            self.found.parts += parts
        for part in self._parts[surface,][0]:
            part.places.append(place)

    def _split(self, surface: Surface, mesh: TriangleMesh, probed: tuple[tuple[bool, bool], ...],
               name: str) -> list[Part]:
        slot = _slot(mesh, surface)
        shows = np.array([shading.has_surface(material) for material in surface.slots])
        emits, textured = np.array(probed).T
        parts = []
        for kind in (False, True):
            chosen = (shows & (emits == kind))[slot]
            if chosen.any():
                part = replace(mesh) if chosen.all() else mesh.take(chosen)  # mostly none shines: no second copy
                part.slot = slot[chosen]
                parts.append(Part(name, part.mirrored() if surface.mirrored else part, surface.slots, kind,
                                  surface.is_shown, is_textured=bool(textured[slot[chosen]].any()),
                                  flux_gain=_gain(surface)))
        return parts

    def _probe(self, material: Material | None, source: int, mesh: TriangleMesh, place: Place) -> tuple[bool, bool]:
        """Whether the material radiates anywhere on some triangles of a mesh that show the unit square of all UVs, and
        whether it is not the same all over them."""
        layers = (*mesh.uv, mesh.active_uv, *mesh.attributes, mesh.active_color)
        key = material, layers
        if key in self._homogeneous:
            return self._homogeneous[key], False
        own = source, material
        if own in self._probed:
            return self._probed[own]
        probe = MaterialTiles(Report())
        some = mesh.take(np.linspace(0, len(mesh) - 1, PROBES).astype(int)) if len(mesh) else mesh
        square = np.resize(UNIT_SQUARE, (len(some), 3, 2))
        ones = {name: np.ones_like(layer) for name, layer in some.attributes.items()}
        some = replace(some, uv=dict.fromkeys(mesh.uv, square), attributes=ones)
        tiles, emission = probe.triangle_tiles(material, some, place)
        found = bool(emission.any()), len(np.unique(tiles)) > 1
        if probe.sharing(material, place) is None:
            self._probed[own] = found
            if len(tiles) and not found[1]:
                self._homogeneous[key] = found[0]
        return found

    def _mesh(self, surface: Surface, place: Place) -> TriangleMesh:
        """Displaced as it is where it stands first."""
        key = surface.source, *surface.slots
        if key not in self._displaced:
            self._displaced[key] = displaced(surface.mesh, surface.slots, place, surface.is_diced, self.report)
        return self._displaced[key]


def _slot(mesh: TriangleMesh, surface: Surface) -> np.ndarray:
    """Material index of each triangle; Blender takes the last slot for an index beyond it."""
    return np.clip(mesh.slot, 0, len(surface.slots) - 1)


def _gain(surface: Surface) -> float:
    return 0.0 if surface.is_dark else 1.0
