# SPDX-License-Identifier: GPL-3.0-or-later
"""Compute a RenderScene from a copied scene; read it top to bottom. No module that it imports uses bpy."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...model import progress, rays
from ...model.normalize import HALF_EXTENT, Normalization
from ...model.scene import RenderScene, View
from .collect import collect
from .data.collected import Collected
from .data.copied import Copied
from .data.memo import Memo
from .data.report import Report
from .fitting.apparent_size import apparent_size
from .fitting.budget import Simplification, allotted
from .fitting.framing import Framing
from .fitting.scene_box import find_box
from .fitting.sizes import Sizes
from .fitting.visible import visible_points
from .lamps.lamps import convert_lamps
from .lamps.one_triangle import one_triangle
from .lamps.world import world_light
from .media import medium
from .media.fog import add_fog, through_fog
from .shading.material import MaterialTiles
from .shading.surfaces import dressed

UNIT_BOX = np.float32([(-HALF_EXTENT,) * 3, (HALF_EXTENT,) * 3])  # what the network's box is without scaling


def compute(copied: Copied, view: View | None, *, token_budget: int, max_edge: float, report,
            steady=lambda framing: framing, baker=None, memo: Memo | None = None, as_is: bool = False,
            paper_lamps: bool = False) -> RenderScene:
    """The arguments of `convert` (scene.py), and of conversions before this one a memo. On any thread; `copied` stays
    as it is."""
    remembered = Memo() if memo is None else memo
    remembered.begin()
    plan = _planned(copied, view, token_budget, max_edge, report, steady, remembered, as_is)
    collected = plan.collected
    with progress.part(0.35, 0.6):
        plan.simplification.apply(report, memo)
    plan.size.subdivide(collected.parts, plan.budget)
    with progress.part(0.6, 0.9):
        surfaces = dressed(collected.parts, MaterialTiles(report, baker), report)
    frame = Normalization.of(RenderScene(box=plan.framing.box))
    lamps = [one_triangle(lamp, frame.center, frame.scale) for lamp in plan.lamps] if paper_lamps else plan.lamps
    scene = surfaces.appended(*lamps)
    with progress.part(0.9, 1.0, "Converting volumes"):
        scene.volumes = medium.cells(collected.media, report)
    scene.environment, scene.box = plan.environment, plan.framing.box
    scene.exposure = np.ones(1, np.float32) if as_is else None
    scene.validate()
    remembered.end()
    return scene


def fitted(copied: Copied, view: View, *, token_budget: int, max_edge: float, as_is: bool = False) -> Framing:
    """What `compute` is fitted to by itself, with the triangles of the meshes."""
    return _planned(copied, view, token_budget, max_edge, Report(), lambda own: own, Memo(), as_is).framing


@dataclass
class _Plan:
    """What was collected of a scene, and what becomes how fine."""

    collected: Collected
    framing: Framing
    lamps: list[RenderScene]
    environment: np.ndarray | None
    budget: int  # for surfaces
    size: Sizes
    simplification: Simplification


def _planned(copied: Copied, view: View | None, token_budget: int, max_edge: float, report, steady,
             memo: Memo, as_is: bool) -> _Plan:
    if not rays.has_embree():
        report.approximated("Speed", "the Python package embreex is missing, so rays take ten times as long: use "
                                     "Install Packages in Preferences > Add-ons > RenderFormer-V2")
    with progress.part(0.0, 0.1, "Converting the world"):
        environment, suns = memo.of(("world", copied.world, id(copied.drawn), as_is), lambda report: world_light(
            copied.world, copied.drawn, report, whole=as_is), report)
    with progress.part(0.1, 0.3):
        collected = collect(copied, report)
    hits, framing = None, Framing(UNIT_BOX if as_is else np.float32(collected.bounds()), None)
    if view is not None:
        hits = visible_points(collected, view, copied.clip_start)
        box = UNIT_BOX if as_is else find_box(collected, view, hits)
        framing = steady(Framing(box, apparent_size(view, hits)))
        if framing.apparent.view is not view:
            hits = visible_points(collected, framing.apparent.view, copied.clip_start)
    progress.report(0.3)
    (low, high), beyond = framing.box, collected.beyond(framing.box)
    if beyond and not as_is:
        report.approximated("Scale", f"the scene is scaled to the {float((high - low).max()):.3g} m around "
                            f"({', '.join(f'{x:.3g}' for x in (low + high) / 2)}) that the camera sees: there is less "
                            f"detail beyond, such as in {', '.join(beyond[:3])}{' ...' if len(beyond) > 3 else ''}")
    eye = None if view is None else view.camera_to_world[:3, 3]
    clear = add_fog(collected, copied.world, framing.box, eye, report)
    environment, suns = through_fog(environment, suns, clear)
    center, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    lamps = convert_lamps(collected.lamps, suns, token_budget // 2, center, radius, clear, report)
    budget = token_budget - sum(map(len, lamps))
    size = Sizes(max_edge, Normalization.of(RenderScene(box=framing.box)), framing.apparent)
    with progress.part(0.3, 0.35):
        wanted = size.wanted(collected.parts, budget)
        progress.report()
        simplification = allotted(collected, budget, framing, hits, wanted, report)
    return _Plan(collected, framing, lamps, environment, budget, size, simplification)
