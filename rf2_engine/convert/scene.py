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
from .collected import Collected, LampInstance, Part
from .focus import find_focus
from .light import COARSE, FINE, convert_light
from .material import MaterialTiles
from .surfaces import dressed
from .world import convert_world


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
    with progress.part(0.0, 0.5):
        found = collect(depsgraph, materials.images, report)
    focus = steady(np.float32(found.bounds()) if view is None else find_focus(found, view, clip_start(depsgraph)))
    (low, high), beyond = focus, found.beyond(focus)
    if beyond:
        report.approximated("Scale", f"the network looks at {float((high - low).max()):.3g} m around "
                            f"({', '.join(f'{x:.3g}' for x in (low + high) / 2)}); farther away, such as parts of "
                            f"{', '.join(beyond[:3])}{' ...' if len(beyond) > 3 else ''}, it sees less")
    lamps = _lamps(found.lamps, token_budget // 2, (low + high) / 2, float(np.linalg.norm(high - low)) / 2, report)
    budget = token_budget - sum(map(len, lamps))
    with progress.part(0.5, 0.7):
        _simplify(found, budget, report)
    _subdivide(found, budget, max_edge, Normalization.of(RenderScene(focus=focus)))
    with progress.part(0.7, 0.9):
        surfaces = dressed(found.parts, materials, report)
    scene = surfaces.appended(functools.reduce(RenderScene.appended, lamps, RenderScene()))
    with progress.part(0.9, 0.95, "Converting volumes"):
        scene.volumes = medium.cells(found.media, report)
    with progress.part(0.95, 1.0, "Converting the world"):
        world = compat.world(depsgraph) if depsgraph.view_layer_eval.use_sky else None
        scene.environment = convert_world(world, report)
    scene.focus = focus
    scene.validate()
    return scene


def _lamps(lamps: list[LampInstance], budget: int, center: np.ndarray, radius: float, report) -> list[RenderScene]:
    """Triangles of each lamp; too many lamps become coarser, and at last the weakest are left out."""
    for detail in FINE, COARSE:
        shapes = [convert_light(lamp.matrix, lamp.light, lamp.name, report, center, radius, detail) for lamp in lamps]
        if sum(map(len, shapes)) <= budget:
            break
        report.approximated("Lamps", "their shapes are coarser than usual: raise the Triangle Budget")
    flux = [(scene.emission.mean(axis=1) * meshes.areas(scene.triangles)).sum() for scene in shapes]
    kept = []
    for i in np.argsort(flux)[::-1]:
        if len(shapes[i]) <= budget:
            kept.append(i)
            budget -= len(shapes[i])
    if len(kept) < len(lamps):
        report.skipped("Lamps", f"no room for {len(lamps) - len(kept)} of {len(lamps)}: raise the Triangle Budget")
    return [shapes[i] for i in sorted(kept)]


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
    instances = [(part.emits, _scale(place.matrix) * float(np.ptp(part.mesh.corners, axis=(0, 1)).max()), i, place)
                 for i, part in enumerate(found.parts) for place in part.places]
    if sum(least[i] for _, _, i, _ in instances) <= budget:
        return
    kept = [[] for _ in found.parts]
    for _, _, i, place in sorted(instances, key=lambda instance: instance[:2], reverse=True):
        if least[i] <= budget:
            kept[i].append(place)
            budget -= least[i]
    for part, places in zip(found.parts, kept, strict=True):
        dropped = len(part.places) - len(places)
        if dropped:
            report.skipped(part.name, f"no room for {dropped} of its {len(part.places)} instances: "
                                      f"raise the Triangle Budget")
        part.places = places
    found.parts = [part for part in found.parts if part.places]


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
