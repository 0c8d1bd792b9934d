# SPDX-License-Identifier: GPL-3.0-or-later
"""One walk over the instances of a depsgraph: what is there, copied out of Blender before anything is computed."""
from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ...model import progress
from . import mesh as meshes
from .material import MaterialTiles
from .medium import Medium, mesh_medium
from .mesh import TriangleMesh
from .report import Report
from .shading import volume
from .vdb import volume_medium

# Curves, surfaces, text and metaballs come a second time, as the mesh they are evaluated to.
WITHOUT_SURFACE = {"CURVE", "SURFACE", "FONT", "META", "EMPTY", "CAMERA", "ARMATURE", "LATTICE", "LIGHT_PROBE",
                   "SPEAKER"}
OF_CYCLES = {"CURVES": "hair curves", "POINTCLOUD": "point clouds"}  # in the first hits, but no triangles
DRAWINGS = {"GREASEPENCIL", "GPENCIL"}
RAYS = ("visible_diffuse", "visible_glossy", "visible_transmission", "visible_shadow")
# What Cycles shades a Volume object without material with: Principled Volume, colour 0.5, density 1.
DEFAULT_MEDIUM = (0.5, 0.5, 0.5), (0.5, 0.5, 0.5)
UNIT_SQUARE = np.array([[(0, 0), (1, 0), (0, 1)], [(1, 1), (0, 1), (1, 0)]], np.float32)  # UV of two triangles


@dataclass
class Part:
    """One mesh with its materials, and everywhere it stands. Emitting triangles are a part of their own."""

    name: str
    mesh: TriangleMesh
    materials: list
    emits: bool
    is_shown: bool                                             # to the camera
    matrices: list[np.ndarray] = field(default_factory=list)  # (4, 4) f64 each, object to world
    flux_gain: float = 1.0                                     # what makes up for emitting area lost to simplification


@dataclass
class LampInstance:
    """One lamp, as bright as its data-block says and wherever it stands."""

    name: str           # of the object
    matrix: np.ndarray  # (4, 4) f64, object to world
    light: object       # bpy Light


@dataclass
class Collected:
    parts: list[Part] = field(default_factory=list)
    lamps: list[LampInstance] = field(default_factory=list)
    media: list[Medium] = field(default_factory=list)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest world coordinates (3,) of surfaces and media; a unit cube if there are none.

        Surfaces that shine count only where there is nothing else: they may stand far away, as lamps do.
        """
        points = [box.corners() for box in self.media]
        for part in [part for part in self.parts if not part.emits] or ([] if points else self.parts):
            points += _boxes(part)
        if not points:
            return np.full(3, -0.5), np.full(3, 0.5)
        points = np.concatenate(points)
        return points.min(axis=0), points.max(axis=0)

    def beyond(self, box: np.ndarray) -> list[str]:
        """Names of the surfaces that reach farther outside a box (2, 3) than it is wide."""
        low, high = box
        room = (high - low).max() + 1e-6
        names = {}
        for part in self.parts:
            for corners in _boxes(part):
                if (corners.min(axis=0) < low - room).any() or (corners.max(axis=0) > high + room).any():
                    names[part.name] = None
        return list(names)


def _boxes(part: Part) -> list[np.ndarray]:
    """(8, 3) world corners of the bounding box of each instance."""
    low, high = part.mesh.corners.min(axis=(0, 1)), part.mesh.corners.max(axis=(0, 1))
    corners = low + np.indices((2, 2, 2)).reshape(3, 8).T * (high - low).astype(np.float64)
    return [corners @ matrix[:3, :3].T + matrix[:3, 3] for matrix in part.matrices]


def collect(depsgraph, images, report) -> Collected:
    """Everything that `depsgraph.object_instances` shows, each evaluated mesh read once.

    images: the ImageCache of this conversion, for textures that decide whether a material emits.
    """
    return _Walk(depsgraph, images, report).run()


class _Walk:
    def __init__(self, depsgraph, images, report):
        self.depsgraph, self.images, self.report = depsgraph, images, report
        self.found = Collected()
        self._read: dict[int, TriangleMesh] = {}
        self._parts: dict[tuple, list[Part]] = {}

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
        if obj.type in WITHOUT_SURFACE or not self._is_seen(obj):
            return
        matrix = np.array(instance.matrix_world, np.float64)
        if not np.isfinite(matrix).all():
            self.report.refused(obj.name, "its transform is not finite")
        elif obj.type == "MESH":
            self._add_mesh(obj, matrix)
        elif obj.type == "LIGHT":
            self.found.lamps.append(LampInstance(obj.name, matrix, obj.data))
        elif obj.type == "VOLUME":
            if self.depsgraph.view_layer_eval.use_volumes:
                self._add_volume(obj, matrix)
        elif obj.type in OF_CYCLES:
            self._add_hair(obj, OF_CYCLES[obj.type])
        elif obj.type in DRAWINGS:
            self.report.approximated(obj.name, "a drawing is laid over the picture, and neither lights it nor is lit")
        else:
            self.report.skipped(obj.name, f"a {obj.type.lower()} cannot be rendered")

    def _is_seen(self, obj) -> bool:
        rays = [getattr(obj, name) for name in RAYS]
        if not any(rays) and not obj.visible_camera:
            return False
        if not all(rays):
            self.report.approximated(obj.name, "Ray Visibility other than Camera is ignored")
        if obj.type == "LIGHT":
            return True
        if obj.is_shadow_catcher:
            self.report.approximated(obj.name, "a shadow catcher is shown like any object")
        if obj.is_holdout:
            self.report.approximated(obj.name, "a holdout lights the scene like any object, and is black unless the "
                                               "film is transparent")
        return True

    def _add_mesh(self, obj, matrix: np.ndarray) -> None:
        if any(s.settings.type == "HAIR" and s.settings.render_type == "PATH" for s in obj.particle_systems):
            self._add_hair(obj, "particle hair")
        slots = meshes.material_slots(obj)
        mirrored = np.linalg.det(matrix[:3, :3]) < 0
        key = (obj.data.as_pointer(), mirrored, obj.visible_camera, *(m and m.as_pointer() for m in slots))
        if key not in self._parts:
            self._parts[key] = self._split(obj, slots, mirrored)
            self.found.parts += self._parts[key]
        for part in self._parts[key]:
            part.matrices.append(matrix)
        mesh = self._mesh(obj)
        for index, material in enumerate(slots):
            coefficients = volume.volume_coefficients(material, self.report)
            corners = mesh.corners[_slot(mesh, slots) == index] if coefficients else ()
            if len(corners):
                self.found.media.append(mesh_medium(obj.name, matrix, corners, *coefficients))

    def _add_hair(self, obj, what: str) -> None:
        """Cycles shows it, but the network is given triangles alone."""
        self.report.approximated(obj.name, f"{what} can be seen, but the network does not know of it: shadows and "
                                           "reflections of it come with Traced Hints alone")

    def _split(self, obj, slots: list, mirrored: bool) -> list[Part]:
        mesh = self._mesh(obj)
        slot = _slot(mesh, slots)
        surface = np.array([volume.has_surface(material) for material in slots])
        emits = np.array([self._emits(material, mesh) for material in slots])
        parts = []
        for kind in (False, True):
            chosen = (surface & (emits == kind))[slot]
            if chosen.any():
                part = mesh.take(chosen)
                part.slot = slot[chosen]
                parts.append(Part(obj.name, part.mirrored() if mirrored else part, slots, kind, obj.visible_camera))
        return parts

    def _emits(self, material, mesh: TriangleMesh) -> bool:
        """Whether the material radiates anywhere on the unit square of a mesh with these UV and colour layers."""
        probe = MaterialTiles(Report())
        probe.images = self.images
        colors = {name: np.ones((2, 3, 3), np.float32) for name in mesh.colors}
        return probe.triangle_tiles(material, dict.fromkeys(mesh.uv, UNIT_SQUARE), mesh.active_uv, 2, colors)[1].any()

    def _mesh(self, obj) -> TriangleMesh:
        pointer = obj.data.as_pointer()
        if pointer not in self._read:
            self._read[pointer] = meshes.read_mesh(obj.data, obj.name, self.report)
        return self._read[pointer]

    def _add_volume(self, obj, matrix: np.ndarray) -> None:
        material = meshes.material_slots(obj)[0]
        coefficients = volume.volume_coefficients(material, self.report) if material else DEFAULT_MEDIUM
        if coefficients is None:
            self.report.skipped(obj.name, f'its material "{material.name}" has no volume shader')
        elif box := volume_medium(obj, matrix, *coefficients, self.report):
            self.found.media.append(box)


def _slot(mesh: TriangleMesh, slots: list) -> np.ndarray:
    """Material index of each triangle; Blender takes the last slot for an index beyond it."""
    return np.clip(mesh.slot, 0, len(slots) - 1)
