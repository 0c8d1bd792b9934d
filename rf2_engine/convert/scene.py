# SPDX-License-Identifier: GPL-3.0-or-later
"""Convert a depsgraph to a RenderScene: copy from Blender first, then compute."""
from __future__ import annotations

from ...model import progress
from ...model.scene import RenderScene, View
from . import compute
from .copying.scene import copy
from .data.report import Report
from .fitting.framing import Framing


def convert(depsgraph, view: View | None, *, token_budget: int, max_edge: float, report,
            steady=lambda framing: framing, by_cycles=None, baker=None, as_is: bool = False,
            paper_lamps: bool = False) -> RenderScene:
    """Everything a render depsgraph shows, in Blender's world frame and units.

    view: of the whole picture, whose surroundings become the network's box (camera/scene_box.py); None = all there is.
    token_budget: most triangles of the result, of which lamps take no more than half. max_edge: longest edge wanted, as
    a fraction of the box's longest side; farther away edges may be longer. report: rf2_engine/convert/data/report.py.
    steady: given the Framing of this picture, that of its key frame.
    by_cycles: a CyclesWorld (cycles/world.py) or None. baker: rf2_engine/cycles/bake.py, for nodes that only Cycles can
    evaluate. as_is: one unit of the world is one of the network's, around the world's origin, and light stays as it is.
    paper_lamps: each lamp is one small triangle (lamps/one_triangle.py).
    Raises SceneError when the scene cannot be converted at all.
    """
    with progress.part(0.0, 0.4):
        copied = copy(depsgraph, report, by_cycles, baker)
    with progress.part(0.4, 1.0):
        return compute.compute(copied, view, token_budget=token_budget, max_edge=max_edge, report=report,
                               steady=steady, baker=baker, as_is=as_is, paper_lamps=paper_lamps)


def fitted(depsgraph, view: View, *, token_budget: int, max_edge: float, by_cycles=None,
           as_is: bool = False) -> Framing:
    """What `convert` of a key frame is fitted to by itself, with the triangles of its meshes."""
    with progress.part(0.0, 0.4):
        copied = copy(depsgraph, Report(), by_cycles)
    with progress.part(0.4, 1.0):
        return compute.fitted(copied, view, token_budget=token_budget, max_edge=max_edge, as_is=as_is)
