# SPDX-License-Identifier: GPL-3.0-or-later
"""A depsgraph as a RenderScene: the way a scene takes through this package, readable top to bottom."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...model import progress, rays
from ...model.normalize import Normalization
from ...model.scene import RenderScene, View
from .. import compat
from .camera.apparent_size import apparent_size
from .camera.camera import clip_start
from .camera.framing import Framing
from .camera.scene_box import find_box
from .camera.visible import visible_points
from .collect import collect
from .collected import Collected
from .lamps.lamps import convert_lamps
from .material import MaterialTiles
from .media import medium
from .media.fog import add_fog, through_fog
from .meshes.budget import Simplification, allotted
from .meshes.sizes import Sizes
from .report import Report
from .surfaces import dressed
from .world import shown_world, world_light


def convert(depsgraph, view: View | None, *, token_budget: int, max_edge: float, report,
            steady=lambda framing: framing, by_cycles=None, baker=None) -> RenderScene:
    """Everything a render depsgraph shows, in Blender's world frame and units.

    view: of the whole picture, whose surroundings become the network's box (camera/scene_box.py); None = all there is.
    token_budget: most triangles of the result, of which lamps take no more than half. max_edge: longest edge wanted, as
    a fraction of the box's longest side; farther away edges may be longer. report: rf2_engine/convert/report.py.
    steady: given the Framing of this picture, that of its key frame.
    by_cycles: as world_light has it. baker: rf2_engine/cycles/bake.py, for nodes that only Cycles can evaluate.
    Raises SceneError when the scene cannot be converted at all.
    """
    materials = MaterialTiles(report, depsgraph.scene_eval.frame_current, baker)
    found = _planned(depsgraph, view, token_budget, max_edge, report, steady, by_cycles, materials.images)
    collected = found.collected
    with progress.part(0.55, 0.7):
        found.simplification.apply(report)
    found.size.subdivide(collected.parts, found.budget)
    with progress.part(0.7, 0.9):
        surfaces = dressed(collected.parts, materials, report)
    scene = surfaces.appended(*found.lamps)
    with progress.part(0.9, 1.0, "Converting volumes"):
        scene.volumes = medium.cells(collected.media, report)
    scene.environment, scene.box = found.environment, found.framing.box
    scene.validate()
    return scene


def fitted(depsgraph, view: View, *, token_budget: int, max_edge: float, by_cycles=None) -> Framing:
    """What `convert` of a key frame is fitted to by itself, with the triangles of its meshes."""
    materials = MaterialTiles(Report(), depsgraph.scene_eval.frame_current)
    return _planned(depsgraph, view, token_budget, max_edge, Report(), lambda own: own, by_cycles,
                    materials.images).framing


@dataclass
class _Plan:
    """A scene that is read, and of which is known what becomes how fine."""

    collected: Collected
    framing: Framing
    lamps: list[RenderScene]
    environment: np.ndarray | None
    budget: int  # for surfaces
    size: Sizes
    simplification: Simplification


def _planned(depsgraph, view: View | None, token_budget: int, max_edge: float, report, steady, by_cycles,
             images) -> _Plan:
    if (space := compat.working_space()) != "Linear Rec.709":
        report.approximated("Working Space", f"{space} is taken for Linear Rec.709: skies and lamps by temperature are "
                                             "off in colour")
    if not rays.has_embree():
        report.approximated("Speed", "the package embreex is missing, so rays take ten times as long: Install Packages "
                                     "in Preferences > Add-ons > RenderFormer-V2 brings it")
    with progress.part(0.0, 0.05, "Converting the world"):  # first, for Cycles may have to evaluate the scene anew
        environment, suns = world_light(depsgraph, report, by_cycles)
    with progress.part(0.05, 0.5):
        collected = collect(depsgraph, images, report)
    hits, framing = None, Framing(np.float32(collected.bounds()), None)
    if view is not None:
        hits = visible_points(collected, view, clip_start(depsgraph))
        framing = steady(Framing(find_box(collected, view, hits), apparent_size(view, hits)))
        if framing.apparent.view is not view:
            hits = visible_points(collected, framing.apparent.view, clip_start(depsgraph))
    progress.report(0.5)
    (low, high), beyond = framing.box, collected.beyond(framing.box)
    if beyond:
        report.approximated("Scale", f"the network looks at {float((high - low).max()):.3g} m around "
                            f"({', '.join(f'{x:.3g}' for x in (low + high) / 2)}); farther away, such as parts of "
                            f"{', '.join(beyond[:3])}{' ...' if len(beyond) > 3 else ''}, it sees less")
    eye = None if view is None else view.camera_to_world[:3, 3]
    clear = add_fog(collected, shown_world(depsgraph), framing.box, eye, report)
    environment, suns = through_fog(environment, suns, clear)
    center, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    lamps = convert_lamps(collected.lamps, suns, token_budget // 2, center, radius, clear, report)
    budget = token_budget - sum(map(len, lamps))
    size = Sizes(max_edge, Normalization.of(RenderScene(box=framing.box)), framing.apparent)
    with progress.part(0.5, 0.55):
        wanted = size.wanted(collected.parts, budget)
        progress.report()
        simplification = allotted(collected, budget, framing, hits, wanted, report)
    return _Plan(collected, framing, lamps, environment, budget, size, simplification)
