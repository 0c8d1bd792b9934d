# SPDX-License-Identifier: GPL-3.0-or-later
"""One walk over the instances of a depsgraph: what is there, copied out of Blender before anything is computed."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...model import progress
from .. import compat
from .attributes import MESH, Asked
from .collected import Collected, LampInstance, Part
from .lamps.light_linking import dark_emitters
from .material import MaterialTiles
from .media.grids import Grid
from .media.volumes import MeshVolume, gridded
from .meshes import mesh as meshes
from .meshes import strands
from .meshes.displace import displaced
from .meshes.mesh import TriangleMesh
from .place import Place
from .report import AS_GOOD_AS_INFINITE, Report
from .shading import volume as shading
from .visibility import gas_domain, hidden_in_renders, is_shown

# Curves, surfaces, text and metaballs come a second time, as the mesh they are evaluated to.
WITHOUT_SURFACE = {"CURVE", "SURFACE", "FONT", "META", "EMPTY", "CAMERA", "ARMATURE", "LATTICE", "LIGHT_PROBE",
                   "SPEAKER"}
STRANDS = {"CURVES": strands.curves_mesh, "POINTCLOUD": strands.cloud_mesh}
DRAWINGS = {"GREASEPENCIL", "GPENCIL"}
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
        self.hidden = hidden_in_renders(depsgraph)
        self.dark = dark_emitters(depsgraph, report)
        self.asked = Asked(depsgraph)
        self.found = Collected()
        self._read: dict[tuple, TriangleMesh] = {}
        self._grids: dict[tuple, dict[str, Grid]] = {}
        self._parts: dict[tuple, tuple[list[Part], list[MeshVolume]]] = {}
        self._shown: dict[tuple, bool] = {}
        self._homogeneous: dict[tuple, bool] = {}  # material and layers of meshes -> it emits
        self._probed: dict[tuple, tuple[bool, bool]] = {}  # by mesh and material, where all instances are alike

    def run(self) -> Collected:
        total = len(self.depsgraph.object_instances)
        for i, instance in enumerate(self.depsgraph.object_instances):
            with progress.part(i / total, (i + 1) / total, f"Reading objects, {i + 1} of {total}"):
                progress.report()
                if instance.show_self and not self._is_hidden(instance):
                    self._add(instance)
        return self.found

    def _is_hidden(self, instance) -> bool:
        host = instance.parent if instance.is_instance else instance.object
        return host is not None and host.original in self.hidden

    def _add(self, instance) -> None:
        obj = instance.object
        if obj.type in WITHOUT_SURFACE or not self._is_shown(instance):
            return
        matrix = np.array(instance.matrix_world, np.float64)
        if not (np.abs(matrix) < AS_GOOD_AS_INFINITE).all():
            self.report.refused(obj.name, "its transform is not finite, or as good as infinite")
        elif obj.type == "VOLUME" or gas_domain(obj):
            made = gridded(obj, self._slots(obj)[0], self._place(instance), self._grids, self.report)
            self.found.media += [made] if made else []
        elif obj.type == "MESH":
            self._add_mesh(obj, self._place(instance), instance.matrix_world.is_negative)
        elif obj.type == "LIGHT":
            if obj.original not in self.dark:
                self.found.lamps.append(LampInstance(obj.name, matrix, obj.data))
        elif obj.type in STRANDS:
            if obj.type == "POINTCLOUD" or self.layer.use_strand:
                self._add_strands(obj, obj.data.as_pointer(), lambda: STRANDS[obj.type](obj.data),
                                  self._place(instance))
        elif obj.type in DRAWINGS:
            self.report.approximated(obj.name, "a drawing is laid over the picture, and neither lights it nor is lit")
        else:
            self.report.skipped(obj.name, f"a {obj.type.lower()} cannot be rendered")

    def _place(self, instance) -> Place:
        return Place.of(instance, self.depsgraph.scene_eval.frame_current_final, self.asked)

    def _is_shown(self, instance) -> bool:
        """Asked once for all instances of an object by another."""
        obj, parent = instance.object, instance.parent
        key = obj.original.as_pointer(), obj.type, instance.is_instance and parent and parent.original.as_pointer()
        if key not in self._shown:
            self._shown[key] = is_shown(instance, self.layer, self.report)
        return self._shown[key]

    def _add_mesh(self, obj, place: Place, mirrored: bool) -> None:
        for system in obj.particle_systems if self.layer.use_strand else ():
            if system.settings.type == "HAIR" and system.settings.render_type == "PATH":
                self._add_strands(obj, system.as_pointer(), lambda s=system: strands.particles_mesh(obj, s), place,
                                  system.settings.material - 1)
        slots, mesh = self._slots(obj), self._mesh(obj, place)
        probed = tuple(self._probe(material, obj.data.as_pointer(), mesh, place) for material in slots)
        key = (obj.data.as_pointer(), mirrored, obj.visible_camera, obj.original in self.dark, probed,
               *(m and m.as_pointer() for m in slots))
        if key not in self._parts:
            self._parts[key] = self._split(obj, mesh, slots, probed, mirrored), self._filled(obj, mesh, slots)
            self.found.parts += self._parts[key][0]
        parts, filled = self._parts[key]
        for part in parts:
            part.places.append(place)
        if np.linalg.det(place.matrix[:3, :3]):  # a flat one is no medium
            self.found.media += [volume.at(place) for volume in filled]

    def _filled(self, obj, mesh: TriangleMesh, slots: list) -> list[MeshVolume]:
        """Of each volume material of a mesh what it fills."""
        filled = []
        for index, material in enumerate(slots):
            corners = mesh.corners[_slot(mesh, slots) == index] if shading.has_volume(material) else ()
            if len(corners):
                filled.append(MeshVolume(obj.name, corners, material, mesh.texture_space, self.report))
        return filled

    def _add_strands(self, obj, pointer: int, read, place: Place, slot: int = 0) -> None:
        """Hair or points, which `read` gives as a mesh, wearing the material of a slot."""
        slots = self._slots(obj)
        key = pointer, obj.visible_camera, obj.original in self.dark, *(m and m.as_pointer() for m in slots)
        if key not in self._parts:
            self.report.approximated(obj.name, "its hair or points are a few larger ones for the network: what is not "
                                               "traced of their shadows and reflections is coarse")
            mesh, material = read(), slots[min(slot, len(slots) - 1)]
            emits, textured = self._probe(material, pointer, mesh, place) if len(mesh) else (False, False)
            gain = 0.0 if obj.original in self.dark else 1.0
            parts = [Part(obj.name, mesh, [material], emits, obj.visible_camera, is_textured=textured,
                          flux_gain=gain)] if len(mesh) else []
            self._parts[key] = parts, []
            self.found.parts += parts
        for part in self._parts[key][0]:
            part.places.append(place)

    def _split(self, obj, mesh: TriangleMesh, slots: list, probed: tuple[tuple[bool, bool], ...],
               mirrored: bool) -> list[Part]:
        slot = _slot(mesh, slots)
        surface = np.array([shading.has_surface(material) for material in slots])
        emits, textured = np.array(probed).T
        parts, flux_gain = [], 0.0 if obj.original in self.dark else 1.0
        for kind in (False, True):
            chosen = (surface & (emits == kind))[slot]
            if chosen.any():
                part = mesh.take(chosen)
                part.slot = slot[chosen]
                parts.append(Part(obj.name, part.mirrored() if mirrored else part, slots, kind, obj.visible_camera,
                                  is_textured=bool(textured[slot[chosen]].any()), flux_gain=flux_gain))
        return parts

    def _slots(self, obj) -> list:
        override = self.layer.material_override
        return [override] if override else meshes.material_slots(obj)

    def _probe(self, material, pointer: int, mesh: TriangleMesh, place: Place) -> tuple[bool, bool]:
        """Whether the material radiates anywhere on some triangles of a mesh that show the unit square of all UVs, and
        whether it is not the same all over them."""
        layers = (*mesh.uv, mesh.active_uv, *mesh.attributes, mesh.active_color)
        key = material and material.as_pointer(), layers
        if key in self._homogeneous:
            return self._homogeneous[key], False
        own = pointer, key[0]
        if own in self._probed:
            return self._probed[own]
        probe = MaterialTiles(Report())
        probe.images = self.images
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

    def _mesh(self, obj, place: Place) -> TriangleMesh:
        """Displaced as it is where it stands first."""
        slots = self._slots(obj)
        key = obj.data.as_pointer(), *(m and m.as_pointer() for m in slots)
        if key not in self._read:
            mesh = meshes.read_mesh(obj.data, obj.name, self.report, self.asked.names[MESH])
            self._read[key] = displaced(mesh, slots, place, compat.is_diced(obj, self.depsgraph.scene_eval),
                                        self.images, self.report)
        return self._read[key]


def _slot(mesh: TriangleMesh, slots: list) -> np.ndarray:
    """Material index of each triangle; Blender takes the last slot for an index beyond it."""
    return np.clip(mesh.slot, 0, len(slots) - 1)
