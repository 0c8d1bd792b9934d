# SPDX-License-Identifier: GPL-3.0-or-later
"""A depsgraph as a RenderScene: the way a scene takes through this package, readable top to bottom."""
from __future__ import annotations

import functools

import numpy as np

from ...model import progress
from ...model.geometry import contracted
from ...model.normalize import Normalization
from ...model.scene import RenderScene, View
from .. import compat
from . import medium, reduce, subdivide
from . import mesh as meshes
from .camera import clip_start
from .collect import collect
from .collected import Collected, Part
from .focus import find_focus
from .lamps import convert_lamps
from .material import MaterialTiles
from .world import world_light


def convert(depsgraph, view: View | None, *, token_budget: int, max_edge: float, report,
            steady=lambda focus: focus) -> RenderScene:
    """Everything a render depsgraph shows, in Blender's world frame and units.

    view: of the whole picture, whose surroundings become the network's box (focus.py); None = all there is.
    token_budget: most triangles of the result, of which lamps take no more than half. max_edge: longest edge wanted, as
    a fraction of the box's longest side; farther away edges may be longer. report: rf2_engine/convert/report.py.
    steady: given the box found here, the one to take.
    Raises SceneError when the scene cannot be converted at all.
    """
    if (space := compat.working_space()) != "Linear Rec.709":
        report.approximated("Working Space", f"{space} is taken for Linear Rec.709: textures, skies are off in colour")
    materials = MaterialTiles(report)
    with progress.part(0.0, 0.45):
        found = collect(depsgraph, materials.images, report)
    with progress.part(0.45, 0.5, "Converting the world"):
        environment, suns = world_light(depsgraph, report)
    focus = steady(np.float32(found.bounds()) if view is None else find_focus(found, view, clip_start(depsgraph)))
    (low, high), beyond = focus, found.beyond(focus)
    if beyond:
        report.approximated("Scale", f"the network looks at {float((high - low).max()):.3g} m around "
                            f"({', '.join(f'{x:.3g}' for x in (low + high) / 2)}); farther away, such as parts of "
                            f"{', '.join(beyond[:3])}{' ...' if len(beyond) > 3 else ''}, it sees less")
    center, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    lamps = convert_lamps(found.lamps, suns, token_budget // 2, center, radius, report)
    budget = token_budget - sum(map(len, lamps))
    with progress.part(0.5, 0.7):
        _simplify(found, budget, report)
    _subdivide(found, budget, max_edge, Normalization.of(RenderScene(focus=focus)))
    with progress.part(0.7, 0.9):
        surfaces = _surfaces(found.parts, materials, report)
    scene = surfaces.appended(functools.reduce(RenderScene.appended, lamps, RenderScene()))
    with progress.part(0.9, 1.0, "Converting volumes"):
        scene.volumes = medium.cells(found.media, report)
    scene.environment, scene.focus = environment, focus
    scene.validate()
    return scene


def _simplify(found: Collected, budget: int, report) -> None:
    _drop_small_instances(found, budget, report)
    parts = found.parts
    shares = reduce.share_budget([len(part.mesh) for part in parts], [len(part.matrices) for part in parts], budget)
    for i, (part, share) in enumerate(zip(parts, shares, strict=True)):
        before = len(part.mesh)
        if share >= before:
            continue
        area = meshes.areas(part.mesh.corners).sum()
        with progress.part(i / len(parts), (i + 1) / len(parts), f"Simplifying meshes, {i + 1} of {len(parts)}"):
            part.mesh = reduce.simplify(part.mesh, int(share))
        part.flux_gain *= area / meshes.areas(part.mesh.corners).sum()
        report.approximated(part.name, f"simplified from {before} to {len(part.mesh)} triangles")


def _drop_small_instances(found: Collected, budget: int, report) -> None:
    """Leave out the smallest instances (lights last) if not even the coarsest shape of all of them fits."""
    least = [min(len(part.mesh), reduce.COARSEST) for part in found.parts]
    instances = [(part.emits, _scale(matrix) * float(np.ptp(part.mesh.corners, axis=(0, 1)).max()), i, matrix)
                 for i, part in enumerate(found.parts) for matrix in part.matrices]
    if sum(least[i] for _, _, i, _ in instances) <= budget:
        return
    kept = [[] for _ in found.parts]
    for _, _, i, matrix in sorted(instances, key=lambda instance: instance[:2], reverse=True):
        if least[i] <= budget:
            kept[i].append(matrix)
            budget -= least[i]
    for part, matrices in zip(found.parts, kept, strict=True):
        dropped = len(part.matrices) - len(matrices)
        if dropped:
            report.skipped(part.name, f"no room for {dropped} of its {len(part.matrices)} instances: "
                                      f"raise the Triangle Budget")
        part.matrices = matrices
    found.parts = [part for part in found.parts if part.matrices]


def _subdivide(found: Collected, budget: int, max_edge: float, frame: Normalization) -> None:
    """Split large triangles of all parts together, so that the largest of the whole scene come first.

    How large they are is measured in the network's box, outside of which space is contracted.
    """
    parts = found.parts
    if not parts:
        return
    counts = np.array([len(part.mesh) for part in parts])
    copies = np.array([len(part.matrices) for part in parts])
    cost = np.where([part.emits for part in parts], 0, copies)
    corners = np.concatenate([frame.points(_nearest(part, frame)) for part in parts])
    parent, weights = subdivide.subdivide(corners, np.repeat(cost, counts), max_edge, budget - int(counts @ copies),
                                          contracted)
    owner = np.repeat(np.arange(len(parts)), counts)[parent]
    for i, part in enumerate(parts):
        mine = owner == i
        if np.count_nonzero(mine) > counts[i]:
            part.mesh = subdivide.pieces(part.mesh, parent[mine] - counts[:i].sum(), weights[mine])


def _nearest(part: Part, frame: Normalization) -> np.ndarray:
    """(n, 3, 3) world corners of the instance that is largest in the network's contracted space."""
    middle = part.mesh.corners.mean(axis=(0, 1))

    def size(matrix: np.ndarray) -> float:
        place = frame.points(matrix[:3, :3] @ middle + matrix[:3, 3])
        return _scale(matrix) / max(float(place @ place), 1)

    matrix = max(part.matrices, key=size)
    return part.mesh.corners @ matrix[:3, :3].T + matrix[:3, 3]


def _scale(matrix: np.ndarray) -> float:
    return float(np.linalg.norm(matrix[:3, :3]))


def _surfaces(parts: list[Part], materials: MaterialTiles, report) -> RenderScene:
    rows: dict[str, list[np.ndarray]] = {"triangles": [], "normals": [], "emission": [], "tile_index": []}
    for i, part in enumerate(parts):
        with progress.part(i / len(parts), (i + 1) / len(parts), f"Reading materials, {i + 1} of {len(parts)}"):
            tile_index, emission = _materials(part, materials)
            there = tile_index >= 0
            if not there.all():
                report.approximated(part.name, f"{np.count_nonzero(~there)} of its {len(there)} triangles, transparent "
                                               "nearly everywhere, are left out")
            for matrix in part.matrices:
                progress.report(1.0)
                corners, normals = meshes.transform(part.mesh, matrix)
                near, solid = meshes.within_reach(corners), meshes.has_area(corners)
                if not near.all():
                    report.refused(part.name, "it reaches farther than numbers do: reset its transform")
                elif not solid.any():
                    report.skipped(part.name, "it is scaled to nothing")
                for name, values in zip(rows, (corners, normals, emission, tile_index), strict=True):
                    rows[name].append(values[near & solid & there])
    scene = RenderScene(tiles=materials.tiles)
    for name, values in rows.items():
        if values:
            setattr(scene, name, np.concatenate(values))
    count = len(scene.triangles)
    scene.beam_axis, scene.beam_cosine = np.zeros((count, 3), np.float32), np.zeros((count, 2), np.float32)
    return scene


def _materials(part: Part, materials: MaterialTiles) -> tuple[np.ndarray, np.ndarray]:
    """(n,) i32 tile and (n, 3) f32 radiance of the triangles of a part."""
    mesh = part.mesh
    tile_index, emission = np.zeros(len(mesh), np.int32), np.zeros((len(mesh), 3), np.float32)
    slots = np.unique(mesh.slot)
    for i, slot in enumerate(slots):
        rows = np.flatnonzero(mesh.slot == slot)
        with progress.part(i / len(slots), (i + 1) / len(slots)):
            tile_index[rows], emission[rows] = materials.triangle_tiles(
                part.materials[slot], mesh.take(rows), part.matrices[0], len(part.matrices))
    return tile_index, emission * np.float32(part.flux_gain)
