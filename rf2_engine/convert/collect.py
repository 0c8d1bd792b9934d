# SPDX-License-Identifier: GPL-3.0-or-later
"""One walk over the instances of a depsgraph: what is there, copied out of Blender before anything is computed."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...model import progress
from . import mesh as meshes
from .collected import Collected, LampInstance, Part
from .light_linking import dark_emitters
from .material import MaterialTiles
from .medium import mesh_medium
from .mesh import TriangleMesh
from .place import Place
from .report import Report
from .shading import volume
from .vdb import volume_medium
from .visibility import is_shown

# Curves, surfaces, text and metaballs come a second time, as the mesh they are evaluated to.
WITHOUT_SURFACE = {"CURVE", "SURFACE", "FONT", "META", "EMPTY", "CAMERA", "ARMATURE", "LATTICE", "LIGHT_PROBE",
                   "SPEAKER"}
OF_CYCLES = {"CURVES": "hair curves", "POINTCLOUD": "point clouds"}  # in the first hits, but no triangles
DRAWINGS = {"GREASEPENCIL", "GPENCIL"}
# What Cycles shades a Volume object without material with: Principled Volume, colour 0.5, density 1.
DEFAULT_MEDIUM = (0.5, 0.5, 0.5), (0.5, 0.5, 0.5)
PROBES = 16  # triangles that tell whether a material emits
UNIT_SQUARE = np.array([[(0, 0), (1, 0), (0, 1)], [(1, 1), (0, 1), (1, 0)]], np.float32)  # UV of two triangles


def collect(depsgraph, images, report) -> Collected:
    """Everything that `depsgraph.object_instances` shows, each evaluated mesh read once.

    images: the ImageCache of this conversion, for textures that decide whether a material emits.
    """
    return _Walk(depsgraph, images, report).run()


class _Walk:
    def __init__(self, depsgraph, images, report):
        self.depsgraph, self.images, self.report = depsgraph, images, report
        self.layer = depsgraph.view_layer_eval
        self.dark = dark_emitters(depsgraph, report)
        self.found = Collected()
        self._read: dict[int, TriangleMesh] = {}
        self._parts: dict[tuple, list[Part]] = {}
        self._emitting: dict[tuple, bool] = {}  # by mesh and material

    def run(self) -> Collected:
        total = len(self.depsgraph.object_instances)
        for i, instance in enumerate(self.depsgraph.object_instances):
            with progress.part(i / total, (i + 1) / total, f"Reading objects, {i + 1} of {total}"):
                progress.report()
                if instance.show_self:
                    self._add(instance)
        return self.found

    def _add(self, instance) -> None:
        obj = instance.object
        if obj.type in WITHOUT_SURFACE or not is_shown(instance, self.layer, self.report):
            return
        matrix = np.array(instance.matrix_world, np.float64)
        if not np.isfinite(matrix).all():
            self.report.refused(obj.name, "its transform is not finite")
        elif obj.type == "MESH":
            self._add_mesh(obj, Place.of(instance, self.depsgraph.scene_eval.frame_current_final))
        elif obj.type == "LIGHT":
            if obj.original not in self.dark:
                self.found.lamps.append(LampInstance(obj.name, matrix, obj.data))
        elif obj.type == "VOLUME":
            self._add_volume(obj, matrix)
        elif obj.type in OF_CYCLES:
            self._add_hair(obj, OF_CYCLES[obj.type])
        elif obj.type in DRAWINGS:
            self.report.approximated(obj.name, "a drawing is laid over the picture, and neither lights it nor is lit")
        else:
            self.report.skipped(obj.name, f"a {obj.type.lower()} cannot be rendered")

    def _add_mesh(self, obj, place: Place) -> None:
        if any(s.settings.type == "HAIR" and s.settings.render_type == "PATH" for s in obj.particle_systems):
            self._add_hair(obj, "particle hair")
        slots, mesh = self._slots(obj), self._mesh(obj)
        emits = tuple(self._emits(material, obj.data, mesh, place) for material in slots)
        mirrored = np.linalg.det(place.matrix[:3, :3]) < 0
        key = (obj.data.as_pointer(), mirrored, obj.visible_camera, obj.original in self.dark, emits,
               *(m and m.as_pointer() for m in slots))
        if key not in self._parts:
            self._parts[key] = self._split(obj, slots, emits, mirrored)
            self.found.parts += self._parts[key]
        for part in self._parts[key]:
            part.places.append(place)
        for index, material in enumerate(slots):
            coefficients = volume.volume_coefficients(material, self.report)
            corners = mesh.corners[_slot(mesh, slots) == index] if coefficients else ()
            if len(corners):
                self.found.media.append(mesh_medium(obj.name, place.matrix, corners, *coefficients))

    def _add_hair(self, obj, what: str) -> None:
        """Cycles shows it, but the network is given triangles alone."""
        self.report.approximated(obj.name, f"{what} can be seen, but the network does not know of it: shadows and "
                                           "reflections of it come with Traced Hints alone")

    def _split(self, obj, slots: list, emits: tuple[bool, ...], mirrored: bool) -> list[Part]:
        mesh = self._mesh(obj)
        slot = _slot(mesh, slots)
        surface = np.array([volume.has_surface(material) for material in slots])
        parts, flux_gain = [], 0.0 if obj.original in self.dark else 1.0
        for kind in (False, True):
            chosen = (surface & (np.array(emits) == kind))[slot]
            if chosen.any():
                part = mesh.take(chosen)
                part.slot = slot[chosen]
                parts.append(Part(obj.name, part.mirrored() if mirrored else part, slots, kind, obj.visible_camera,
                                  flux_gain=flux_gain))
        return parts

    def _slots(self, obj) -> list:
        override = self.layer.material_override
        return [override] if override else meshes.material_slots(obj)

    def _emits(self, material, data, mesh: TriangleMesh, place: Place) -> bool:
        """Whether the material radiates anywhere on some triangles of a mesh that show the unit square of all UVs."""
        key = data.as_pointer(), material and material.as_pointer()
        if key in self._emitting:
            return self._emitting[key]
        probe = MaterialTiles(Report())
        probe.images = self.images
        some = mesh.take(np.linspace(0, len(mesh) - 1, PROBES).astype(int)) if len(mesh) else mesh
        square = np.resize(UNIT_SQUARE, (len(some), 3, 2))
        white = np.ones((len(some), 3, 4), np.float32)
        some = replace(some, uv=dict.fromkeys(mesh.uv, square), colors=dict.fromkeys(mesh.colors, white))
        emits = bool(probe.triangle_tiles(material, some, place)[1].any())
        if probe.sharing(material, place) is None:
            self._emitting[key] = emits
        return emits

    def _mesh(self, obj) -> TriangleMesh:
        pointer = obj.data.as_pointer()
        if pointer not in self._read:
            self._read[pointer] = meshes.read_mesh(obj.data, obj.name, self.report)
        return self._read[pointer]

    def _add_volume(self, obj, matrix: np.ndarray) -> None:
        material = self._slots(obj)[0]
        coefficients = volume.volume_coefficients(material, self.report) if material else DEFAULT_MEDIUM
        if coefficients is None:
            self.report.skipped(obj.name, f'its material "{material.name}" has no volume shader')
        elif box := volume_medium(obj, matrix, *coefficients, self.report):
            self.found.media.append(box)


def _slot(mesh: TriangleMesh, slots: list) -> np.ndarray:
    """Material index of each triangle; Blender takes the last slot for an index beyond it."""
    return np.clip(mesh.slot, 0, len(slots) - 1)
