# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender materials to material tiles and emission (docs/scene-input.md 3, 4)."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...model import progress
from ...model.scene import (
    BASE_COLOR,
    HEIGHT,
    IOR,
    METALLIC,
    NORMAL,
    ROUGHNESS,
    TILE_CHANNELS,
    TILE_SIZE,
    TRANSMISSION,
    barycentric_grid,
    constant_tile,
)
from .shading import graph
from .shading.closure import Closure, SurfaceParameters, parameters
from .shading.evaluate import Evaluator, Points
from .shading.image import ImageCache
from .shading.node_call import NodeCall
from .shading.surface import closure_at
from .shading.volume import has_surface

CHUNK = 256                  # triangles evaluated at once
HEIGHT_UNIT = 0.025          # world units of displacement at height 1
EMITTER_RADIANCE = 1.0       # from here on the own light of a surface outshines what it reflects
DARK_FRACTION = 0.01         # triangles this much darker than the brightest one of an emission texture do not shine
EMITTER_TILE = constant_tile(base_color=(1, 1, 1), roughness=1, ior=1)


class MaterialTiles:
    """Collects the tiles of one conversion; equal homogeneous materials share a tile."""

    def __init__(self, report):
        self.report, self.images = report, ImageCache(report)
        self._chunks: list[np.ndarray] = []
        self._count = 0
        self._constant: dict[bytes, int] = {}

    @property
    def tiles(self) -> np.ndarray:
        """(T, 11, 32, 32) f16, the rows that the returned tile indices mean."""
        empty = np.zeros((0, TILE_CHANNELS, TILE_SIZE, TILE_SIZE), np.float16)
        return np.concatenate([empty, *self._chunks])

    def triangle_tiles(self, material, uv_layers: dict[str, np.ndarray], active_uv: str | None, n: int,
                       colors: dict[str, np.ndarray] | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Tiles and emission of `n` triangles that wear `material` (a bpy Material or None).

        uv_layers: (n, 3, 2) f32 per UV layer, corner order of the triangles; active_uv: the layer that Blender renders
        by default; colors: (n, 3, 3) f32 scene-linear per colour attribute. Returns tile index (n,) i32 and radiance
        (n, 3) f32. A homogeneous material has one tile, one with textures a tile per triangle.
        """
        emission = np.zeros((n, 3), np.float32)
        if n == 0:
            return np.zeros(0, np.int32), emission
        if material is None:
            return np.full(n, self._constant_index(constant_tile()), np.int32), emission
        index = np.empty(n, np.int32)
        uv = {name: np.pad(layer, ((0, 0), (0, 0), (0, 1))) for name, layer in uv_layers.items()}
        corner_data = uv, colors or {}
        for start in range(0, n, CHUNK):
            progress.report(start / n)
            part = slice(start, min(start + CHUNK, n))
            on_grid = [{name: _interpolated(layer[part]) for name, layer in data.items()} for data in corner_data]
            points = Points(uv=on_grid[0], active_uv=active_uv, colors=on_grid[1], camera_ray=True)
            surface, height = self._evaluate(material, points)
            emission[part] = self.report.finite(material.name, "its emission", _triangle_mean(surface.emission))
            tiles = self.report.finite(material.name, "its surface", tile_arrays(surface, height))
            if len(tiles) == 1 and part.stop - start > 1 and surface.emission.ndim == 1:
                index[:], emission[:] = self._constant_index(tiles[0]), emission[start]
                break
            if len(tiles) == 1:
                index[part] = self._constant_index(tiles[0])
            else:
                index[part] = np.arange(self._count, self._count + len(tiles))
                self._append(tiles)
        emission[emission.max(axis=1) < DARK_FRACTION * emission.max()] = 0
        emitters = emission.max(axis=1) >= EMITTER_RADIANCE
        if emitters.any():
            index[emitters] = self._constant_index(EMITTER_TILE)
        return index, emission

    def _evaluate(self, material, points: Points) -> tuple[SurfaceParameters, np.ndarray]:
        tree = material.node_tree if material.use_nodes else None
        evaluator = Evaluator(points, self.images, self.report, material.name)
        if tree is None:
            color = np.array(material.diffuse_color[:3], np.float32)
            return SurfaceParameters(color, *(np.full(1, x, np.float32) for x in (0, 1, 1, 0)),
                                     np.array([0, 0, 1], np.float32), np.zeros(3, np.float32)), np.zeros(1, np.float32)
        output = graph.output_node(tree)
        output = None if output is None else NodeCall(evaluator, output)
        closure = Closure() if output is None else closure_at(output, "Surface")
        if evaluator.depends_on_ray:
            lighting = Evaluator(replace(points, camera_ray=False), self.images, self.report, material.name)
            closure.emission = closure_at(NodeCall(lighting, output.node), "Surface").emission
        if not closure.weight.any() and not closure.emission.any() and has_surface(material):
            self.report.approximated(material.name, "no surface shader reaches the Material Output: it is black")
        return parameters(closure), _height(material, output)

    def _constant_index(self, tile: np.ndarray) -> int:
        key = tile.tobytes()
        if key not in self._constant:
            self._constant[key] = self._count
            self._append(tile[None])
        return self._constant[key]

    def _append(self, tiles: np.ndarray) -> None:
        self._chunks.append(tiles)
        self._count += len(tiles)


def _height(material, output: NodeCall | None) -> np.ndarray:
    """Displacement over 0.025 world units (docs/scene-input.md 4.6); objects are taken to be of scale 1."""
    n = None if output is None else output.source("Displacement")
    if n is None:
        return np.zeros(1, np.float32)
    if n.kind != "ShaderNodeDisplacement":
        n.approximated(f"{n.node.bl_label} displacement is left out")
        return np.zeros(1, np.float32)
    displacement = (n["Height"] - n["Midlevel"]) * n["Scale"] / HEIGHT_UNIT
    if material.displacement_method == "BUMP":
        n.approximated("displacement as bump only is shown as displacement")
    if np.any(np.abs(displacement) > 1):
        n.approximated(f"displacement is limited to {HEIGHT_UNIT} units")
    return np.clip(displacement, -1, 1)


def tile_arrays(surface: SurfaceParameters, height: np.ndarray) -> np.ndarray:
    """(m, 11, 32, 32) f16, m = 1 when no parameter varies over the surface."""
    placed = ((BASE_COLOR, surface.base_color), (METALLIC, surface.metallic), (ROUGHNESS, surface.roughness),
              (IOR, surface.ior), (TRANSMISSION, surface.transmission), (NORMAL, surface.normal), (HEIGHT, height))
    count = max(len(values) if values.ndim > 1 else 1 for _, values in placed)
    tiles = np.empty((count, TILE_CHANNELS, TILE_SIZE, TILE_SIZE), np.float16)
    for channel, values in placed:
        channels = slice(channel, channel + 1) if isinstance(channel, int) else channel
        full = np.broadcast_to(values, (count, TILE_SIZE, TILE_SIZE, values.shape[-1]))
        tiles[:, channels] = np.moveaxis(full, -1, 1)
    return tiles


def _interpolated(corners: np.ndarray) -> np.ndarray:
    """(m, 3, c) corner values -> (m, 32, 32, c) on the tile grid, extrapolated beyond the hypotenuse."""
    return np.einsum("rck,mkd->mrcd", barycentric_grid(), corners, optimize=True).astype(np.float32)


def _triangle_mean(emission: np.ndarray) -> np.ndarray:
    """(3,) or (m, 32, 32, 3) -> (3,) or (m, 3): mean over the cells inside the triangle."""
    if emission.ndim == 1:
        return emission
    rows = np.arange(TILE_SIZE)
    inside = rows[:, None] + rows[None] < TILE_SIZE
    return emission[:, inside].mean(axis=1)
