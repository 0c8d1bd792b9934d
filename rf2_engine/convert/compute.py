# SPDX-License-Identifier: GPL-3.0-or-later
"""Compute a RenderScene from a copied scene; read it top to bottom. No module that it imports uses bpy."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...model import progress
from ...model.normalize import HALF_EXTENT, Normalization
from ...model.scene import BOUNCES, RenderScene, View
from ...model.scene_rays import scene_rays
from .collect import collect
from .data.cache import ConversionCache
from .data.collected import CollectedScene
from .data.copied import ConversionOptions, CopiedScene
from .data.report import Report
from .fitting.apparent_size import measure_apparent_size
from .fitting.budget import Simplification, allot_triangles
from .fitting.framing import Framing, find_box
from .fitting.real_surfaces import match_tokens
from .fitting.sizes import Sizes
from .fitting.visible import find_visible
from .lamps.lamps import convert_lamps, split_negative
from .lamps.one_triangle import one_triangle
from .lamps.placed_lamp import BoundingSphere
from .lamps.world import WorldLight, convert_world_light
from .media import medium
from .media.fire import fire_of
from .media.fog import add_fog
from .shading.glow import with_glow
from .shading.hit_materials import HitMaterials
from .shading.material_tiles import MaterialTiles
from .shading.surfaces import assemble_surfaces

UNIT_BOX = np.float32([(-HALF_EXTENT,) * 3, (HALF_EXTENT,) * 3])  # what the network's box is without scaling


def own_framing(framing: Framing) -> Framing:
    """The choice of each picture's own Framing, which is not that of a key frame."""
    return framing


def compute(copied: CopiedScene, view: View | None, options: ConversionOptions, report: Report, *,
            choose_framing: Callable[[Framing], Framing] = own_framing, baker=None,
            cache: ConversionCache | None = None, hit_materials: HitMaterials | None = None) -> RenderScene:
    """The second half of `convert` (scene.py), on any thread; `copied` is not changed.

    cache: of earlier conversions, for scenes that are converted again and again. hit_materials: an empty one, to be
    filled.
    """
    if cache is not None:
        cache.begin()
    plan = _plan(copied, view, options, report, choose_framing, cache or ConversionCache())
    collected = plan.collected
    with progress.part(0.35, 0.6):
        plan.simplification.apply(report, cache)
    plan.sizes.subdivide(collected.parts, plan.budget)
    with progress.part(0.6, 0.7):
        match_tokens(collected.parts, report, cache)
    with progress.part(0.7, 0.9):
        tiles = MaterialTiles(report, baker, options.keeps_lobes)
        surfaces = assemble_surfaces(collected.parts, tiles, report, hit_materials)
    frame, lamps = Normalization.of(RenderScene(box=plan.framing.box)), plan.lamps
    if options.paper_lamps:
        lamps = [one_triangle(lamp, frame.center, frame.scale) for lamp in lamps]
    scene = surfaces.appended(*lamps)
    scene.negative = plan.negative
    with progress.part(0.9, 1.0, "Converting volumes"):
        scene.volumes, scene.fire = medium.cells(collected.media, report), fire_of(collected.media)
    _add_world(scene, copied, plan.sky)
    scene.box = plan.framing.box
    scene.bounces = None if copied.bounces == BOUNCES else np.int32(copied.bounces)
    scene.caustics = None if all(copied.caustics) else np.array(copied.caustics)
    scene.exposure = np.ones(1, np.float32) if options.as_is else None
    scene = scene if options.as_is else with_glow(scene)
    scene.validate()
    if hit_materials is not None:
        hit_materials.geometry = scene.surfaces
    if cache is not None:
        scene_rays(scene, cache.trees)
        cache.end()
    return scene


def _add_world(scene: RenderScene, copied: CopiedScene, sky: WorldLight) -> None:
    scene.environment = sky.environment
    if sky.others:
        scene.other_rays = np.uint8(list(sky.others))
        scene.other_environments = np.stack(list(sky.others.values()))
    if copied.world is not None and copied.world.hidden:
        scene.environment_hidden = np.uint8([copied.world.hidden])
    if copied.world_light_group:
        scene.environment_group = np.array([copied.world_light_group], np.int32)


def find_framing(copied: CopiedScene, view: View, options: ConversionOptions) -> Framing:
    """The Framing that `compute` finds for this picture, with the triangles of its meshes."""
    return _plan(copied, view, options, Report(), own_framing, ConversionCache()).framing


@dataclass
class _Plan:
    """The parts of a scene, and how fine each will be."""

    collected: CollectedScene
    framing: Framing
    lamps: list[RenderScene]
    negative: RenderScene | None  # lamps
    sky: WorldLight
    budget: int  # triangles for surfaces
    sizes: Sizes
    simplification: Simplification


def _plan(copied: CopiedScene, view: View | None, options: ConversionOptions, report: Report,
          choose_framing: Callable[[Framing], Framing], cache: ConversionCache) -> _Plan:
    with progress.part(0.0, 0.1, "Converting the world"):
        key = "world", copied.world, id(copied.world_panoramas), options.as_is
        sky = cache.get(key, lambda report: convert_world_light(
            copied.world, copied.world_panoramas, report, keep_suns=options.as_is), report)
    with progress.part(0.1, 0.3):
        collected = collect(copied, report)
    hits, framing = None, Framing(UNIT_BOX if options.as_is else np.float32(collected.bounds()), None)
    if view is not None:
        hits = find_visible(collected, view)
        box = UNIT_BOX if options.as_is else find_box(collected, view, hits)
        framing = choose_framing(Framing(box, measure_apparent_size(view, hits)))
        if framing.apparent.view is not view:
            hits = find_visible(collected, framing.apparent.view)
    progress.report(0.3)
    (low, high), beyond = framing.box, collected.beyond(framing.box)
    if beyond and not options.as_is:
        report.approximated("Scale", f"the scene is scaled to the {float((high - low).max()):.3g} m around "
                            f"({', '.join(f'{x:.3g}' for x in (low + high) / 2)}) that the camera sees: there is less "
                            f"detail beyond, such as in {', '.join(beyond[:3])}{' ...' if len(beyond) > 3 else ''}")
    shown = None if hits is None else hits.points
    clear = add_fog(collected, copied.world, framing.box, view, shown, report)
    sky = sky.dimmed(clear)
    suns = [replace(sun, light_group=copied.world_light_group) for sun in sky.suns]
    sphere, most = BoundingSphere.of_box(low, high), options.token_budget // 2
    positive, negative = split_negative(collected.lamps)
    lamps = convert_lamps(positive, suns, most, sphere, clear, report)
    negative_lamps = convert_lamps(negative, [], most, sphere, clear, report)
    negative_lamp = negative_lamps[0].appended(*negative_lamps[1:]) if negative_lamps else None
    budget = options.token_budget - sum(map(len, lamps))
    sizes = Sizes(options.max_edge, Normalization.of(RenderScene(box=framing.box)), framing.apparent)
    with progress.part(0.3, 0.35):
        targets = sizes.find_targets(collected.parts, budget)
        progress.report()
        simplification = allot_triangles(collected, budget, framing, hits, targets, report)
    return _Plan(collected, framing, lamps, negative_lamp, sky, budget, sizes, simplification)
