# SPDX-License-Identifier: GPL-3.0-or-later
"""Copy a scene from Blender: the first half of a conversion, on the thread that Blender calls us on."""
from __future__ import annotations

from collections.abc import Callable

from ....model import progress, rays
from ... import compat
from ...setup import packages
from ..data.copied import CopiedScene
from ..data.report import Report
from ..lamps.world import draw_world
from ..shading.material import needs_baking
from .blocks import REC709, Blocks
from .cache import CopyCache
from .instances import add_instances, light_groups
from .visibility import hidden_in_renders


def copy(depsgraph, report: Report, cycles_world=None, baker=None, cache: CopyCache | None = None,
         hides: Callable[[object], bool] | None = None, reads_images: bool = True) -> CopiedScene:
    """What a render depsgraph shows; nothing of it refers to Blender's data, which may change or go away afterwards.

    cycles_world: as in `draw_world`. baker: is made ready where nodes will have to be baked. cache: what was read for
    copies before. hides: says of an original object that it is not shown, in a picture that is no render.
    reads_images: else all are grey.
    """
    if (space := compat.working_space()) != REC709:
        report.approximated("Working Space", f"{space} is treated as Linear Rec.709: colors of skies and of lights "
                                             "with a temperature are wrong")
    if not rays.has_embree():
        report.approximated("Speed", "the Python package embreex is missing, so rays take ten times as long"
                            + f": use {packages.BUTTON}" * packages.can_install(["embreex"]))
    frame = depsgraph.scene_eval.frame_current
    cache = CopyCache() if cache is None else cache
    with progress.part(0.0, 0.1, "Converting the world"):  # first, for Cycles may have to evaluate the scene anew
        world_block = rendered_world(depsgraph)
        world = cache.world_of(world_block, frame, lambda: Blocks(frame, depsgraph, cache.images, reads_images).of(
            world_block))
        copied = CopiedScene(world, draw_world(cycles_world, world))
        if world_block is not None:
            groups = light_groups(depsgraph.view_layer_eval)
            copied.world_light_group = groups.get(world_block.lightgroup, 0)
    with progress.part(0.1, 0.9):
        blocks = Blocks(frame, depsgraph, cache.images, reads_images)
        add_instances(copied, depsgraph, blocks, report, cache, hides or hidden_in_renders(depsgraph).__contains__)
    if (cycles := getattr(depsgraph.scene_eval, "cycles", None)) is not None:
        copied.bounces = (cycles.diffuse_bounces, cycles.glossy_bounces, cycles.transmission_bounces,
                          cycles.max_bounces)
        copied.caustics = cycles.caustics_reflective, cycles.caustics_refractive
    if baker is not None and any(map(needs_baking, blocks.materials)):
        with progress.part(0.9, 1.0):
            baker.prepare()
    return copied


def rendered_world(depsgraph):
    """The world of the view layer that is rendered, None if it shows none."""
    return compat.world(depsgraph) if depsgraph.view_layer_eval.use_sky else None
