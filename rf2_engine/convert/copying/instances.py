# SPDX-License-Identifier: GPL-3.0-or-later
"""Copy the instances of a depsgraph in one walk, before anything is computed."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from ....model import progress
from ....model.scene import ALL_GROUPS, ANY
from ....model.surface_kinds import BOUNCED, Ray
from ... import compat
from ..data.copied import CopiedMesh, CopiedScene, Grid, Instance, LampInstance, Particle, Reach
from ..data.mesh import TriangleMesh
from ..data.report import AS_GOOD_AS_INFINITE, Report
from ..shading.noise.hashing import LARGEST, jenkins
from . import strands
from .attributes import MESH, RequestedAttributes
from .blocks import Blocks
from .cache import CopyCache
from .meshes import material_slots
from .visibility import gas_domain, hidden_rays, is_holdout, is_shown, read_light_linking, shows_something
from .volumes import gridded

# Curves, surfaces, text and metaballs come a second time, as the mesh they are evaluated to.
WITHOUT_SURFACE = {"CURVE", "SURFACE", "FONT", "META", "EMPTY", "CAMERA", "ARMATURE", "LATTICE", "LIGHT_PROBE",
                   "SPEAKER"}
STRANDS = {"CURVES": strands.read_curves, "POINTCLOUD": strands.read_point_cloud}
SEEING_LAMPS = BOUNCED | Ray.SCATTER  # cameras do not, and shadows are not of lamps
DRAWINGS = {"GREASEPENCIL", "GPENCIL"}


def add_instances(copied: CopiedScene, depsgraph, blocks: Blocks, report: Report, cache: CopyCache,
                  hides: Callable) -> None:
    """Everything that `depsgraph.object_instances` shows, each evaluated mesh read once.

    hides: says of an original object that it is not shown, nor what it instances.
    """
    _Walk(copied, depsgraph, blocks, report, cache, hides).run()


class _Walk:
    def __init__(self, copied: CopiedScene, depsgraph, blocks: Blocks, report: Report, cache: CopyCache,
                 hides: Callable):
        self.copied, self.depsgraph, self.blocks, self.report = copied, depsgraph, blocks, report
        self.cache, self.hides = cache, hides
        self.layer = depsgraph.view_layer_eval
        self.linking = read_light_linking(depsgraph, report)
        self.light_groups = light_groups(self.layer)
        self.requested = RequestedAttributes(depsgraph)
        self._read: dict[tuple, TriangleMesh] = {}
        self._grids: dict[tuple, dict[str, Grid]] = {}
        self._surfaces: dict[tuple, CopiedMesh] = {}
        self._shown: dict[tuple, bool] = {}

    def run(self) -> None:
        total = len(self.depsgraph.object_instances)
        for i, instance in enumerate(self.depsgraph.object_instances):
            with progress.part(i / total, (i + 1) / total, f"Reading objects, {i + 1} of {total}"):
                progress.report()
                if shows_something(instance) and not self._is_hidden(instance):
                    self._add(instance)
        self.cache.meshes.drop_unused()

    def _is_hidden(self, instance) -> bool:
        host = instance.parent if instance.is_instance else instance.object
        return host is not None and self.hides(host.original)

    def _add(self, instance) -> None:
        obj = instance.object
        if obj.type in WITHOUT_SURFACE or not self._is_shown(instance):
            return
        matrix = np.array(instance.matrix_world, np.float64)
        if not (np.abs(matrix) < AS_GOOD_AS_INFINITE).all():
            self.report.refused(obj.name, "its transform has values that are infinite or too large")
        elif instance.show_self and (obj.type == "VOLUME" or gas_domain(obj)):
            volume = gridded(obj, self._slots(obj)[0], self._copy_instance(instance), self._grids, self.report)
            self.copied.objects += [volume] if volume else []
        elif obj.type == "MESH":
            copied = self._copy_instance(instance)
            if instance.show_particles and self.layer.use_strand:
                self._add_hair(obj, copied, hidden_rays(instance))
            if instance.show_self:
                self._add_mesh(obj, copied, instance.matrix_world.is_negative, hidden_rays(instance))
        elif obj.type == "LIGHT":
            if obj.original not in self.linking.dark:
                lit, blockers = self._linked_groups(obj)
                reach = Reach(hidden_rays(instance) & SEEING_LAMPS, min(obj.data.cycles.max_bounces, ANY), lit,
                              blockers if obj.data.use_shadow else 0)
                self.copied.lamps.append(LampInstance(obj.name, matrix, self.blocks.of(obj.data), reach,
                                                       self.light_groups.get(obj.lightgroup, 0)))
        elif obj.type in STRANDS:
            if obj.type == "POINTCLOUD" or self.layer.use_strand:
                self._add_strands(obj, obj.data.as_pointer(), partial(STRANDS[obj.type], obj),
                                  self._copy_instance(instance), hidden_rays(instance))
        elif obj.type in DRAWINGS:
            self.report.approximated(obj.name, "it is drawn over the picture: it neither lights the scene nor "
                                               "receives light")
        else:
            self.report.skipped(obj.name, f"a {obj.type.lower()} cannot be rendered")

    def _copy_instance(self, instance) -> Instance:
        read = read_instance(instance, self.depsgraph.scene_eval.frame_current_final, self.requested)
        return replace(read, group=self.linking.group.get(instance.object.original, 0),
                       is_holdout=is_holdout(instance, self.layer),
                       light_group=self.light_groups.get(instance.object.lightgroup, 0))

    def _linked_groups(self, obj) -> tuple[int, int]:
        """The groups that the light of an object falls on, and those that stop it."""
        return (self.linking.lit_groups.get(obj.original, ALL_GROUPS),
                self.linking.blockers.get(obj.original, ALL_GROUPS))

    def _is_shown(self, instance) -> bool:
        """Evaluated once for all instances of an object by another."""
        obj, parent = instance.object, instance.parent
        key = obj.original.as_pointer(), obj.type, instance.is_instance and parent and parent.original.as_pointer()
        if key not in self._shown:
            self._shown[key] = is_shown(instance, self.layer)
        return self._shown[key]

    def _add_hair(self, obj, instance: Instance, hidden: int) -> None:
        for system in obj.particle_systems:
            if system.settings.type == "HAIR" and system.settings.render_type == "PATH":
                read = partial(strands.read_particles, obj, system, self.depsgraph.mode == "RENDER")
                self._add_strands(obj, system.as_pointer(), read, instance, hidden,
                                  system.settings.material - 1)

    def _add_mesh(self, obj, instance: Instance, mirrored: bool, hidden: int) -> None:
        slots, source, is_dark = self._slots(obj), obj.data.as_pointer(), obj.original in self.linking.dark
        key = source, mirrored, hidden, is_dark, self._linked_groups(obj), *slots
        if key not in self._surfaces:
            self._surfaces[key] = CopiedMesh(source, self._mesh(obj, slots), slots, mirrored, hidden,
                                             is_dark, compat.is_diced(obj, self.depsgraph.scene_eval),
                                             *self._linked_groups(obj))
        self.copied.objects.append((self._surfaces[key], instance))

    def _add_strands(self, obj, pointer: int, read, instance: Instance, hidden: int, slot: int = 0) -> None:
        """Hair or points, known by a pointer, which `read` returns as Strands, with the material of a slot."""
        slots, is_dark = self._slots(obj), obj.original in self.linking.dark
        key = pointer, None, hidden, is_dark, *slots
        if key not in self._surfaces:
            hair = self.cache.meshes.strands_of(obj, pointer, read, self.requested.names[MESH], self.report)
            self._surfaces[key] = CopiedMesh(pointer, hair.tokens, slots, False, hidden, is_dark,
                                             strands_slot=min(slot, len(slots) - 1), real=hair.real)
        self.copied.objects.append((self._surfaces[key], instance))

    def _slots(self, obj) -> list:
        override = self.layer.material_override
        return [self.blocks.of(block) for block in ([override] if override else material_slots(obj))]

    def _mesh(self, obj, slots: list) -> TriangleMesh:
        key = obj.data.as_pointer(), *slots
        if key not in self._read:
            self._read[key] = self.cache.meshes.of(obj, self.requested.names[MESH], self.report)
        return self._read[key]


def light_groups(layer) -> dict[str, int]:
    """The number of each light group of a view layer, by name."""
    return {group.name: number for number, group in enumerate(layer.lightgroups, 1)}


def read_instance(instance, frame: float, requested: RequestedAttributes) -> Instance:
    """Copied from a DepsgraphObjectInstance, which lives for one step of the walk alone."""
    obj = instance.object
    if instance.is_instance:
        random = (instance.random_id & 0xffffffff) / LARGEST
    else:
        random = jenkins(_of_name(obj.name), 0) / LARGEST
    return Instance(np.array(instance.matrix_world, np.float64), obj.name, tuple(obj.color), obj.pass_index,
                    float(random), tuple(instance.orco), tuple(instance.uv), _particle(instance, frame),
                    requested.read_object(obj), requested.read_instancer(instance), requested.view_layer_properties)


def _particle(instance, frame: float) -> Particle:
    system = instance.particle_system if instance.is_instance else None
    index = instance.persistent_id[0] if system else 0
    if system is None or not 0 <= index < len(system.particles):
        return Particle()
    particle = system.particles[index]
    return Particle(index, frame - particle.birth_time, particle.lifetime, tuple(particle.location), particle.size,
                    tuple(particle.velocity), tuple(particle.angular_velocity))


def _of_name(name: str) -> int:
    """Cycles' hash of a string."""
    code = 0
    for byte in name.encode():
        code = (code * 37 + byte - 256 * (byte > 127)) & 0xffffffff
    return code
