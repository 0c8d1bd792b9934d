# SPDX-License-Identifier: GPL-3.0-or-later
"""Convert a depsgraph to a RenderScene: copy from Blender first, then compute."""
from __future__ import annotations

from ...model import progress
from ...model.scene import RenderScene, View
from . import compute
from .copying.scene import copy
from .data.copied import ConversionOptions
from .data.report import Report
from .fitting.framing import Framing


def convert(depsgraph, view: View | None, options: ConversionOptions, report: Report, *,
            choose_framing=compute.own_framing, cycles_world=None, baker=None, cache=None) -> RenderScene:
    """Everything that a render depsgraph shows, in Blender's world frame and units.

    view: of the full picture, whose surroundings become the network's box (fitting/framing.py); None: all there is.
    choose_framing: Framing of this picture -> the one to use, such as that of a key frame. cycles_world: a CyclesWorld
    (cycles/world.py), for worlds that only Cycles can evaluate. baker: a Baker (cycles/bake.py), for such nodes.
    cache: what was read of the same frame before (copying/cache.py).
    Raises SceneError when the scene cannot be converted at all.
    """
    with progress.part(0.0, 0.4):
        copied = copy(depsgraph, report, cycles_world, baker, cache)
    with progress.part(0.4, 1.0):
        return compute.compute(copied, view, options, report, choose_framing=choose_framing, baker=baker)


def find_framing(depsgraph, view: View, options: ConversionOptions, *, cycles_world=None) -> Framing:
    """The Framing that `convert` finds for this picture, with the triangles of its meshes."""
    with progress.part(0.0, 0.4):
        copied = copy(depsgraph, Report(), cycles_world)
    with progress.part(0.4, 1.0):
        return compute.find_framing(copied, view, options)
