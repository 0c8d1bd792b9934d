# SPDX-License-Identifier: GPL-3.0-or-later
"""The triangles of all instances, with their materials, and the real surfaces that these stand for."""
from __future__ import annotations

import numpy as np

from ....model import progress
from ....model.geometry import area_vectors, unit
from ....model.scene import HALF_SPACE, SELDOM, Geometry, RenderScene
from ..data import mesh as meshes
from ..data.collected import Part
from ..data.copied import Instance
from ..data.report import Report
from .appearance import TriangleAppearance, find_appearance
from .hit_materials import HitMaterials
from .material_tiles import MaterialTiles

# Arrays of a RenderScene that it does without where all triangles have this value.
USUAL = {"hidden": 0, "light_group": 0} | {name: SELDOM[name] for name in (
    "group", "lit_groups", "blockers", "is_holdout", "shadow_tile", "emission_tile")}


def assemble_surfaces(parts: list[Part], materials: MaterialTiles, report: Report,
                      hit_materials: HitMaterials | None = None) -> RenderScene:
    """Surfaces and mesh emitters in world space; instances share the tiles that do not depend on the instance.

    hit_materials: records the mesh and instance of all rows of the geometry.
    """
    names = "triangles", "normals", *TriangleAppearance._fields, *USUAL
    rows: dict[str, list[np.ndarray]] = {name: [] for name in names}
    geometry: dict[str, list[np.ndarray]] = {"triangles": [], "normals": [], "token": []}
    count = 0
    for i, part in enumerate(parts):
        with progress.part(i / len(parts), (i + 1) / len(parts), f"Reading materials, {i + 1} of {len(parts)}"):
            shared = {}
            for j, instance in enumerate(part.instances):
                with progress.part(j / len(part.instances), (j + 1) / len(part.instances)):
                    progress.report()
                    tokens, is_kept = _instance_fields(part, instance, materials, shared, report)
                    _add(rows, {name: values[is_kept] for name, values in tokens.items()})
                    row = np.where(is_kept, count + np.cumsum(is_kept) - 1, -1).astype(np.int32)
                    for real, is_real in _real_surfaces(part, instance, tokens, row):
                        _add(geometry, real)
                        if hit_materials is not None:
                            hit_materials.add(part, instance, materials, is_real)
                    count += np.count_nonzero(is_kept)
    scene = _join(rows, materials, count)
    if any(part.real or any(instance.real_matrices for instance in part.instances) for part in parts):
        scene.geometry = Geometry(**{name: np.concatenate(values) for name, values in geometry.items()})
    return scene


def _join(rows: dict[str, list[np.ndarray]], materials: MaterialTiles, count: int) -> RenderScene:
    """The scene of `count` triangles with these fields, each in the arrays of all instances."""
    scene = RenderScene(tiles=materials.tiles, latents=materials.latents, two_lobes=materials.two_lobes,
                        emission_tiles=materials.emission_tiles, **materials.extras)
    sides = rows.pop("shining_side")
    for name, values in rows.items():
        if values:
            setattr(scene, name, np.concatenate(values))
    for name, usual in USUAL.items():
        if not rows[name] or (getattr(scene, name) == usual).all():
            setattr(scene, name, None)
    for name in ("camera_tile", "back_tile"):
        if not rows[name] or (getattr(scene, name) == scene.tile_index).all():
            setattr(scene, name, None)
    scene.beam_axis, scene.beam_cosine = np.zeros((count, 3), np.float32), np.zeros((count, 2), np.float32)
    side = np.concatenate([np.zeros(0, np.int32), *sides])
    if side.any():
        scene.beam_axis = (side[:, None] * unit(area_vectors(scene.triangles))).astype(np.float32)
        scene.beam_cosine[side != 0] = HALF_SPACE
    return scene


def _add(lists: dict[str, list[np.ndarray]], values: dict[str, np.ndarray]) -> None:
    for name, array in values.items():
        lists[name].append(array)


def _instance_fields(part: Part, instance: Instance, materials: MaterialTiles, shared: dict,
                     report: Report) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Fields of a RenderScene for the triangles of one instance, and which of these show.

    shared: as in `_instance_appearance`.
    """
    appearance = _instance_appearance(part, instance, materials, shared)
    is_opaque = appearance.tile_index >= 0
    if not is_opaque.all():
        report.approximated(part.name, f"{np.count_nonzero(~is_opaque)} of its {len(is_opaque)} triangles are left "
                                       "out, because they are almost fully transparent")
    corners, normals = meshes.transform(part.mesh, instance.matrix)
    near, solid = _is_usable(corners)
    if not near.all():
        report.refused(part.name, "it is too large or too far away: reset its transform")
    elif not solid.any():
        report.skipped(part.name, "its scale is 0")
    return ({"triangles": corners, "normals": normals,
             "light_group": np.full(len(corners), instance.light_group, np.int32),
             "group": np.full(len(corners), instance.group, np.uint8),
             "lit_groups": np.full(len(corners), part.lit_groups, np.uint64),
             "blockers": np.full(len(corners), part.blockers, np.uint64)}
            | appearance._asdict(), near & solid & is_opaque)


def _is_usable(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n,) bool and (n,) bool: triangles that are not too far away, and those that have an area."""
    return meshes.within_reach(corners), meshes.has_area(corners)


def _real_surfaces(part: Part, instance: Instance, tokens: dict[str, np.ndarray],
                   row: np.ndarray) -> list[tuple[dict[str, np.ndarray], np.ndarray]]:
    """Fields of a Geometry for what the tokens of an instance stand for, and which triangles of its mesh these are.

    row: (n,) i32 of the tokens in the scene, or -1.
    """
    if part.real is None and not instance.real_matrices:
        is_kept = row >= 0
        return [({"triangles": tokens["triangles"][is_kept], "normals": tokens["normals"][is_kept],
                  "token": row[is_kept]}, is_kept)]
    mesh, token = (part.mesh, row) if part.real is None else (part.real, row[part.token])
    surfaces, is_flat = [], (row < 0).any()  # then triangles may have become lines
    for matrix in instance.real_matrices or (instance.matrix,):
        progress.report()
        corners, normals = meshes.transform(mesh, matrix)
        is_kept = token >= 0
        if is_flat or instance.real_matrices:
            is_kept &= np.logical_and(*_is_usable(corners))
        fields = {"triangles": corners, "normals": normals, "token": token}
        fields = fields if is_kept.all() else {name: values[is_kept] for name, values in fields.items()}
        surfaces.append((fields, is_kept))
    return surfaces


def _instance_appearance(part: Part, instance: Instance, materials: MaterialTiles, shared: dict) -> TriangleAppearance:
    """The appearance of the triangles of an instance of a part.

    shared: by material slot and MaterialTiles.sharing what instances have in common, filled here.
    """
    mesh = part.mesh
    appearance = TriangleAppearance.empty(len(mesh))
    slots = np.unique(mesh.slot)
    for i, slot in enumerate(slots):
        rows, material = np.flatnonzero(mesh.slot == slot), part.materials[slot]
        shaded = shared.get((slot, materials.sharing(material, instance)))
        with progress.part(i / len(slots), (i + 1) / len(slots)):
            if shaded is None:
                shaded = find_appearance(materials, material, mesh.take(rows), instance)
                shared[slot, materials.sharing(material, instance)] = shaded
            for whole, values in zip(appearance, shaded, strict=True):
                whole[rows] = values
    gain = np.reshape(part.flux_gain, (-1, 1)).astype(np.float32)
    return appearance._replace(emission=appearance.emission * gain, hidden=appearance.hidden | np.uint8(part.hidden),
                               is_holdout=appearance.is_holdout | instance.is_holdout)
