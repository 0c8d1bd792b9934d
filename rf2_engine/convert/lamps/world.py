# SPDX-License-Identifier: GPL-3.0-or-later
"""The world's light as a latitude-longitude map (docs/scene-input.md 7)."""
from __future__ import annotations

import functools
import math
import operator
from dataclasses import dataclass, replace

import numpy as np

from ....model import progress
from ....model.geometry import latlong_directions
from ....model.scene import ENVIRONMENT_SHAPE
from ....model.surface_kinds import Ray
from ..data.blocks import World
from ..data.copied import Reach, Sun
from ..data.report import Report
from ..shading import graph, sky
from ..shading.evaluate import Evaluator
from ..shading.input_nodes import light_path_value
from ..shading.node_call import OF_A_NODE, NodeCall
from ..shading.points import Points
from ..shading.surface import closure_at
from .lamp_triangles import SUN_ANGLE
from .suns import split_suns

MAX_SUPERSAMPLING = 4  # rays per texel and axis; larger images are reduced first
EYES = Ray.DIFFUSE | Ray.GLOSSY | Ray.TRANSMISSION | Ray.SCATTER  # rays that can see different worlds
BAND_ROWS = 16        # texel rows evaluated at once
SKY, FEW = "ShaderNodeTexSky", (0, 8, 16)  # first row, rows and columns of directions that show what nodes say


@dataclass
class WorldLight:
    """Panoramas of a world without its suns, by the rays that see them, and the suns. Diffuse rays see the first."""

    panoramas: dict[Ray, np.ndarray]
    suns: list[Sun]

    def dimmed(self, clear: np.ndarray) -> WorldLight:
        """As it shines through fog that lets this share (3,) of light through."""
        return WorldLight({rays: (panorama * clear).astype(np.float32) for rays, panorama in self.panoramas.items()},
                          [replace(sun, irradiance=sun.irradiance * clear) for sun in self.suns if clear.any()])

    @property
    def environment(self) -> np.ndarray | None:
        """What diffuse rays see; None where no ray sees anything."""
        return next(iter(self.panoramas.values())) if any(map(np.any, self.panoramas.values())) else None

    @property
    def others(self) -> dict[Ray, np.ndarray]:
        """What rays see that see something else."""
        return dict(list(self.panoramas.items())[1:])


def draw_world(cycles_world, world: World | None) -> dict[Ray, tuple[np.ndarray, list[Sun]]] | None:
    """A world's panoramas without its suns, and the suns, by the rays that see them, rendered by a CyclesWorld
    (cycles/world.py) where nodes cannot be evaluated here; None where that is not necessary or not possible."""
    if world is None or cycles_world is None or _is_exact(world):
        return None
    drawn = {rays: cycles_world.light(_rough_suns(world), ray) for rays, ray in _who_sees_alike(world).items()}
    return drawn if all(drawn.values()) else None


def convert_world_light(world: World | None, drawn: dict | None, report: Report, keep_suns: bool = False) -> WorldLight:
    """What a world sends out (`convert_world`).

    drawn: what Cycles has drawn of it (`draw_world`). keep_suns: small bright areas of it stay where they are.
    """
    panoramas, suns = {}, []
    for rays, ray in _who_sees_alike(world).items():
        if drawn:
            panoramas[rays], own = drawn[rays]
        else:
            panoramas[rays], own = convert_world(world, report, ray), []
            if not keep_suns:
                panoramas[rays], own = split_suns(panoramas[rays])
        suns += [replace(sun, reach=Reach(world.hidden | EYES & ~rays)) for sun in own]
    if suns:
        what = f"{len(suns)} small bright areas become sun lights" if len(suns) > 1 else \
            "a small bright area becomes a sun light"
        report.approximated(world.name, f"in estimated light {what}, at least {math.degrees(SUN_ANGLE):g} degrees wide")
    return WorldLight(panoramas, suns)


def _who_sees_alike(world: World | None) -> dict[Ray, Ray]:
    """Sets of rays to which Light Path says the same in this world, and a ray of each; that of diffuse ones first."""
    nodes = () if world is None or world.node_tree is None else world.node_tree.all_nodes()
    sources = [socket.source for node in nodes for socket in node.inputs if socket.source is not None]
    asked = {output.name for output in sources if output.node.bl_idname == "ShaderNodeLightPath"}
    alike = {}
    for ray in () if world is None else EYES:
        alike.setdefault(tuple(light_path_value(name, ray) for name in sorted(asked)), []).append(ray)
    return {functools.reduce(operator.or_, rays): rays[0] for rays in alike.values()}


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
    return split_suns(convert_world(world, Report()))[1]


def convert_world(world: World, report: Report, ray: Ray = Ray.DIFFUSE) -> np.ndarray:
    """(256, 512, 3) f32 radiance, scene-linear, by direction as in docs/scene-input.md 7.1, as such rays see it.

    Every texel is the mean over its solid angle, so the energy of small bright suns in an HDRI is kept.
    """
    if world.node_tree is None:
        return np.broadcast_to(np.float32(world.color), ENVIRONMENT_SHAPE).copy()
    output = graph.output_node(world.node_tree)
    if output is None:
        return np.zeros(ENVIRONMENT_SHAPE, np.float32)
    fineness, bands = _supersampling(world), []
    is_even = _emission(output, latlong_directions(np.arange(1), 1, 1), report, world, ray).ndim == 1
    columns = 1 if is_even else ENVIRONMENT_SHAPE[1]
    for row in range(0, ENVIRONMENT_SHAPE[0], BAND_ROWS):
        with progress.part(row / ENVIRONMENT_SHAPE[0], (row + BAND_ROWS) / ENVIRONMENT_SHAPE[0]):
            progress.report()
            bands.append(_band(output, row, columns, fineness, report, world, ray))
    environment = np.concatenate(bands)
    return environment.repeat(ENVIRONMENT_SHAPE[1], 1) if is_even else environment


def _supersampling(world: World) -> int:
    """Rays per texel and axis that meet every texel of the images in the tree."""
    if not world.widths or world.has_groups:
        return MAX_SUPERSAMPLING
    return int(np.clip(np.ceil(max(world.widths) / ENVIRONMENT_SHAPE[1]), 2, MAX_SUPERSAMPLING))


def _emission(output, directions: np.ndarray, report: Report, world: World, ray: Ray) -> np.ndarray:
    """(..., 3) radiance of a world from unit directions (..., 3); (3,) where it is the same from all."""
    evaluator = Evaluator(Points(direction=directions, ray=ray), world.node_tree.conventions, report, world.name)
    emission = closure_at(NodeCall(evaluator, output), "Surface").emission
    emission = report.finite(world.name, "its light", emission)
    if (emission < 0).any():
        report.approximated(world.name, "negative light is ignored")
    return np.maximum(emission, 0)


def _band(output, first_row, columns, fineness, report: Report, world: World, ray: Ray) -> np.ndarray:
    """(BAND_ROWS, columns, 3) rows of the map."""
    height, width = ENVIRONMENT_SHAPE[0] * fineness, columns * fineness
    rows = np.arange(first_row * fineness, (first_row + BAND_ROWS) * fineness)
    radiance = _emission(output, latlong_directions(rows, height, width), report, world, ray)
    radiance = np.broadcast_to(radiance, (len(rows), width, 3)).reshape(BAND_ROWS, fineness, -1, fineness, 3)
    weight = np.sin(np.pi * (rows + 0.5) / height).reshape(BAND_ROWS, fineness)
    weight = weight / weight.sum(axis=1, keepdims=True) / fineness
    return np.einsum("rswtc,rs->rwc", radiance, weight).astype(np.float32)
