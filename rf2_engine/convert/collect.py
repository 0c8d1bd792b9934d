# SPDX-License-Identifier: GPL-3.0-or-later
"""Divide the copied scene into parts that emit light, parts that do not, and media; displace them."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...model import progress
from .data.blocks import Material
from .data.collected import CollectedScene, Part
from .data.copied import CopiedMesh, CopiedScene, CopiedVolume, Instance
from .data.mesh import TriangleMesh
from .data.report import Report
from .media.volumes import MeshVolume, gridded
from .meshes.displace import displace
from .shading import volume as shading
from .shading.material_tiles import EMITTER_RADIANCE, MaterialTiles

PROBES = 16  # triangles that tell whether a material emits
UNIT_SQUARE = np.array([[(0, 0), (1, 0), (0, 1)], [(1, 1), (0, 1), (1, 0)]], np.float32)  # UV of two triangles


def collect(copied: CopiedScene, report: Report) -> CollectedScene:
    """Each mesh is displaced and divided once for all its instances that look alike."""
    return _Collection(report).of(copied)


class _Collection:
    def __init__(self, report: Report):
        self.report = report
        self.collected = CollectedScene()
        self._displaced: dict[tuple, TriangleMesh] = {}
        self._parts: dict[tuple, tuple[list[Part], list[MeshVolume]]] = {}
        self._homogeneous: dict[tuple, bool] = {}  # material and layers of meshes -> it emits
        self._probed: dict[tuple, tuple[bool, bool]] = {}  # by mesh and material, where all instances are alike

    def of(self, copied: CopiedScene) -> CollectedScene:
        self.collected.lamps = copied.lamps
        total = len(copied.objects)
        for i, item in enumerate(copied.objects):
            with progress.part(i / total, (i + 1) / total, f"Preparing objects, {i + 1} of {total}"):
                progress.report()
                if isinstance(item, CopiedVolume):
                    self.collected.media.append(gridded(item, self.report))
                elif item[0].strands_slot is not None:
                    self._add_strands(*item)
                else:
                    self._add_mesh(*item)
        return self.collected

    def _add_mesh(self, surface: CopiedMesh, instance: Instance) -> None:
        mesh = self._displaced_mesh(surface, instance)
        probed = tuple(self._probe(material, surface.source, mesh, instance) for material in surface.slots)
        key = surface, probed, instance.light_group
        if key not in self._parts:
            name = instance.name
            self._parts[key] = self._split(surface, mesh, probed, name), self._filled(surface, mesh, name)
            self.collected.parts += self._parts[key][0]
        parts, filled = self._parts[key]
        for part in parts:
            part.instances.append(instance)
        if np.linalg.det(instance.matrix[:3, :3]):  # a flat one is no medium
            self.collected.media += [volume.at(instance) for volume in filled]

    def _filled(self, surface: CopiedMesh, mesh: TriangleMesh, name: str) -> list[MeshVolume]:
        """The volume that each volume material of a mesh fills."""
        filled = []
        for index, material in enumerate(surface.slots):
            corners = mesh.corners[surface.find_slots(mesh) == index] if shading.has_volume(material) else ()
            if len(corners):
                filled.append(MeshVolume(name, corners, material, mesh.texture_space, self.report))
        return filled

    def _add_strands(self, surface: CopiedMesh, instance: Instance) -> None:
        """Hair or points, which have one material."""
        if (surface,) not in self._parts:
            mesh, material = surface.mesh, surface.slots[surface.strands_slot]
            emits, textured = self._probe(material, surface.source, mesh, instance) if len(mesh) else (False, False)
            parts = [Part(instance.name, mesh, [material], emits, surface.is_shown, is_textured=textured,
                          flux_gain=_gain(surface), real=surface.real, hidden=surface.hidden,
                          lit_groups=surface.lit_groups, blockers=surface.blockers)] if len(mesh) else []
            self._parts[surface,] = parts, []
            self.collected.parts += parts
        for part in self._parts[surface,][0]:
            part.instances.append(instance)

    def _split(self, surface: CopiedMesh, mesh: TriangleMesh, probed: tuple[tuple[bool, bool], ...],
               name: str) -> list[Part]:
        slot = surface.find_slots(mesh)
        shows = np.array([shading.has_surface(material) for material in surface.slots])
        emits, textured = np.array(probed).T
        parts = []
        for kind in (False, True):
            chosen = (shows & (emits == kind))[slot]
            if chosen.any():
                part = mesh if chosen.all() else mesh.take(chosen)  # mostly none emits: no second copy, nor digest
                if (part.slot != slot[chosen]).any():
                    part = replace(part, slot=slot[chosen])
                parts.append(Part(name, part.mirrored() if surface.mirrored else part, surface.slots, kind,
                                  surface.is_shown, is_textured=bool(textured[slot[chosen]].any()),
                                  flux_gain=_gain(surface), hidden=surface.hidden,
                                  lit_groups=surface.lit_groups, blockers=surface.blockers))
        return parts

    def _probe(self, material: Material | None, source: int, mesh: TriangleMesh,
               instance: Instance) -> tuple[bool, bool]:
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
        tiles, emission = probe.triangle_tiles(material, some, instance)
        appearance = bool((emission >= EMITTER_RADIANCE).any()), len(np.unique(tiles)) > 1
        if probe.sharing(material, instance) is None:
            self._probed[own] = appearance
            if len(tiles) and not appearance[1]:
                self._homogeneous[key] = appearance[0]
        return appearance

    def _displaced_mesh(self, surface: CopiedMesh, instance: Instance) -> TriangleMesh:
        """Displaced as in its first instance."""
        key = surface.source, *surface.slots
        if key not in self._displaced:
            self._displaced[key] = displace(surface.mesh, surface.slots, instance, surface.is_diced, self.report)
        return self._displaced[key]


def _gain(surface: CopiedMesh) -> float:
    return 0.0 if surface.is_dark else 1.0
