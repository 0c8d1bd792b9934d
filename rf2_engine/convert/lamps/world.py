# SPDX-License-Identifier: GPL-3.0-or-later
"""The world's light as a latitude-longitude map (docs/scene-input.md 7)."""
from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ....model import progress
from ....model.geometry import latlong_directions
from ....model.scene import ENVIRONMENT_SHAPE
from ..data.blocks import World
from ..data.copied import Reach, Sun
from ..data.report import Report
from ..shading import graph, sky
from ..shading.evaluate import Evaluator
from ..shading.node_call import OF_A_NODE, NodeCall
from ..shading.points import Points
from ..shading.surface import closure_at
from .lamp_triangles import SUN_ANGLE
from .suns import split_suns

MAX_SUPERSAMPLING = 4  # rays per texel and axis; larger images are reduced first
BAND_ROWS = 16        # texel rows evaluated at once
SKY, FEW = "ShaderNodeTexSky", (0, 8, 16)  # first row, rows and columns of directions that show what nodes say


def draw_world(cycles_world, world: World | None) -> tuple[np.ndarray | None, list[Sun]] | None:
    """A world's panorama without its suns, and the suns, rendered by a CyclesWorld (cycles/world.py) where nodes cannot
    be evaluated here; None where that is not necessary or not possible."""
    if world is None or cycles_world is None or _is_exact(world):
        return None
    drawn = cycles_world.light(_rough_suns(world))
    return drawn and (_none_if_black(drawn[0]), drawn[1])


def convert_world_light(world: World | None, drawn: tuple | None, report,
                        keep_suns: bool = False) -> tuple[np.ndarray | None, list[Sun]]:
    """The panorama of a world (`convert_world`) without its suns, and the suns.

    drawn: what Cycles has drawn of it (`draw_world`). whole: small bright areas of it stay where they are.
    """
    if world is None:
        return None, []
    if drawn:
        environment, suns = drawn
    else:
        environment, suns = convert_world(world, report), []
        if environment is not None and not keep_suns:
            environment, suns = split_suns(environment)
    if suns:
        what = f"{len(suns)} small bright areas become sun lights" if len(suns) > 1 else \
            "a small bright area becomes a sun light"
        report.approximated(world.name, f"in estimated light {what}, at least {math.degrees(SUN_ANGLE):g} degrees wide")
    return environment, [replace(sun, reach=Reach(world.hidden)) for sun in suns]


def _is_exact(world: World) -> bool:
    """Whether `convert_world` shows it as it is."""
    output = graph.output_node(world.node_tree)
    if output is None:
        return True
    if any(node.bl_idname == SKY for node in world.node_tree.all_nodes()):
        return False
    remarks, points = Report(), Points(direction=latlong_directions(np.arange(*FEW[:2]), *FEW[1:]))
    evaluator = Evaluator(points, world.node_tree.conventions, remarks, world.name)
    closure_at(NodeCall(evaluator, output), "Surface")
    return not any(remark.message.startswith(OF_A_NODE) for remark in remarks.entries)


def _rough_suns(world) -> list[Sun]:
    """Where Sky Textures show their sun, if they do; how bright it is remains open."""
    nodes = world.node_tree.all_nodes()
    skies = [node for node in nodes if node.bl_idname == SKY and node.sun_disc and sky.is_physical(node)]
    if not skies:
        return []
    if all(graph.source(graph.find_input(node, "Vector"))[1] is None for node in skies):
        return [Sun(sky.sun_direction(node), np.ones(3), node.sun_size) for node in skies]
    environment = convert_world(world, Report())
    return [] if environment is None else split_suns(environment)[1]


def convert_world(world: World | None, report) -> np.ndarray | None:
    """(256, 512, 3) f32 radiance, scene-linear, by direction as in docs/scene-input.md 7.1; None when it is black.

    Every texel is the mean over its solid angle, so the energy of small bright suns in an HDRI is kept.
    """
    if world is None:
        return None
    if world.node_tree is None:
        return _none_if_black(np.broadcast_to(np.float32(world.color), ENVIRONMENT_SHAPE).copy())
    output = graph.output_node(world.node_tree)
    if output is None:
        return None
    fineness, bands = _supersampling(world), []
    is_even = _emission(output, latlong_directions(np.arange(1), 1, 1), report, world).ndim == 1
    columns = 1 if is_even else ENVIRONMENT_SHAPE[1]
    for row in range(0, ENVIRONMENT_SHAPE[0], BAND_ROWS):
        with progress.part(row / ENVIRONMENT_SHAPE[0], (row + BAND_ROWS) / ENVIRONMENT_SHAPE[0]):
            progress.report()
            bands.append(_band(output, row, columns, fineness, report, world))
    environment = np.concatenate(bands)
    return _none_if_black(environment.repeat(ENVIRONMENT_SHAPE[1], 1) if is_even else environment)


def _supersampling(world: World) -> int:
    """Rays per texel and axis that meet every texel of the images in the tree."""
    if not world.widths or world.has_groups:
        return MAX_SUPERSAMPLING
    return int(np.clip(np.ceil(max(world.widths) / ENVIRONMENT_SHAPE[1]), 2, MAX_SUPERSAMPLING))


def _emission(output, directions: np.ndarray, report, world: World) -> np.ndarray:
    """(..., 3) radiance of a world from unit directions (..., 3); (3,) where it is the same from all."""
    evaluator = Evaluator(Points(direction=directions), world.node_tree.conventions, report, world.name)
    emission = closure_at(NodeCall(evaluator, output), "Surface").emission
    emission = report.finite(world.name, "its light", emission)
    if (emission < 0).any():
        report.approximated(world.name, "negative light is ignored")
    return np.maximum(emission, 0)


def _band(output, first_row, columns, fineness, report, world: World) -> np.ndarray:
    """BAND_ROWS rows of the map, of so many columns."""
    height, width = ENVIRONMENT_SHAPE[0] * fineness, columns * fineness
    rows = np.arange(first_row * fineness, (first_row + BAND_ROWS) * fineness)
    radiance = _emission(output, latlong_directions(rows, height, width), report, world)
    radiance = np.broadcast_to(radiance, (len(rows), width, 3)).reshape(BAND_ROWS, fineness, -1, fineness, 3)
    weight = np.sin(np.pi * (rows + 0.5) / height).reshape(BAND_ROWS, fineness)
    weight = weight / weight.sum(axis=1, keepdims=True) / fineness
    return np.einsum("rswtc,rs->rwc", radiance, weight).astype(np.float32)


def _none_if_black(environment: np.ndarray) -> np.ndarray | None:
    return environment if environment.any() else None
