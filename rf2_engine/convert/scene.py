# SPDX-License-Identifier: GPL-3.0-or-later
"""A depsgraph as a RenderScene: the way a scene takes through this package, readable top to bottom."""
from __future__ import annotations

import functools

import numpy as np

from ...model import progress
from ...model.normalize import Normalization
from ...model.scene import RenderScene, View
from .. import compat
from . import medium
from . import mesh as meshes
from .budget import fit
from .camera import clip_start
from .collect import collect
from .collected import Part
from .focus import find_focus
from .lamps import convert_lamps
from .material import MaterialTiles
from .seen import look
from .sight import sight_of
from .sizes import Sizes
from .world import world_light


def convert(depsgraph, view: View | None, *, token_budget: int, max_edge: float, report,
            steady=lambda focus, view: (focus, view)) -> RenderScene:
    """Everything a render depsgraph shows, in Blender's world frame and units.

    view: of the whole picture, whose surroundings become the network's box (focus.py); None = all there is.
    token_budget: most triangles of the result, of which lamps take no more than half. max_edge: longest edge wanted, as
    a fraction of the box's longest side; farther away edges may be longer. report: rf2_engine/convert/report.py.
    steady: given the box found here and the view, the box to take and the view to allot triangles by.
    Raises SceneError when the scene cannot be converted at all.
    """
    if (space := compat.working_space()) != "Linear Rec.709":
        report.approximated("Working Space", f"{space} is taken for Linear Rec.709: textures, skies are off in colour")
    materials = MaterialTiles(report)
    with progress.part(0.0, 0.45):
        found = collect(depsgraph, materials.images, report)
    with progress.part(0.45, 0.5, "Converting the world"):
        environment, suns = world_light(depsgraph, report)
    sight, hits, focus = None, None, np.float32(found.bounds())
    if view is not None:
        hits = look(found, view, clip_start(depsgraph))
        focus, allotted_by = steady(find_focus(found, view, hits), view)
        if allotted_by is not view:
            hits = look(found, allotted_by, clip_start(depsgraph))
        sight = sight_of(allotted_by, hits)
    (low, high), beyond = focus, found.beyond(focus)
    if beyond:
        report.approximated("Scale", f"the network looks at {float((high - low).max()):.3g} m around "
                            f"({', '.join(f'{x:.3g}' for x in (low + high) / 2)}); farther away, such as parts of "
                            f"{', '.join(beyond[:3])}{' ...' if len(beyond) > 3 else ''}, it sees less")
    center, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    lamps = convert_lamps(found.lamps, suns, token_budget // 2, center, radius, report)
    budget = token_budget - sum(map(len, lamps))
    size = Sizes(max_edge, Normalization.of(RenderScene(focus=focus)), sight)
    with progress.part(0.5, 0.7):
        fit(found, budget, sight, hits, size.wanted(found.parts, budget), report)
    size.subdivide(found.parts, budget)
    with progress.part(0.7, 0.9):
        surfaces = _surfaces(found.parts, materials, report)
    scene = surfaces.appended(functools.reduce(RenderScene.appended, lamps, RenderScene()))
    with progress.part(0.9, 1.0, "Converting volumes"):
        scene.volumes = medium.cells(found.media, report)
    scene.environment, scene.focus = environment, focus
    scene.validate()
    return scene


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
