# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender materials to material tiles and emission (docs/scene-input.md 3, 4)."""
from __future__ import annotations

from dataclasses import fields

import numpy as np

from ....model import progress
from ....model.fields import Channels
from ....model.scene import (
    BASE_COLOR,
    COAT,
    EMISSION_SIZE,
    HEIGHT,
    IOR,
    METALLIC,
    NORMAL,
    ROUGHNESS,
    SHEEN,
    TILE_CHANNELS,
    TILE_SIZE,
    TRANSMISSION,
    TWO_LOBES,
    cells_inside,
    constant_tile,
)
from ....model.surface_kinds import Ray
from ..data.blocks import Material
from ..data.copied import Instance
from ..data.mesh import TriangleMesh, areas, face_normals
from ..data.report import Report
from . import graph
from .closure import Closure, SurfaceParameters, joined, lobe, parameters
from .evaluate import Evaluator
from .node_call import NodeCall
from .normal_map import bend_normal
from .points import Points, surface_points
from .surface import closure_at
from .two_lobes import lobe_nodes, two_lobes
from .volume import has_surface

HEIGHT_UNIT = 0.025          # world units of displacement at height 1 (docs/scene-input.md 4.6)
SCALE_DIGITS = 3             # squares of sizes that differ by less are the same
CHUNK = 256                  # triangles evaluated at once
BAKED_CHUNK = 1024           # and where some may be baked, for which Cycles reads the whole scene each time
EMITTER_RADIANCE = 1.0       # from here on the own light of a surface outshines what it reflects
DARK_FRACTION = 0.01         # of an emission texture: darker triangles do not shine if all are as small a share of it
LEAST_SOLID = 1e-3           # share of a cell that counts, at least: the mean of what is clear everywhere is not 0 / 0
CLEAR = 0.95                 # a triangle that lets more light straight through than this is left out
UNEVEN = 0.05                # of the mean emission of a triangle: it is a picture where it differs by more
MOST_PICTURES = 256          # triangles of a mesh with one; a finer mesh shows it by its triangles
ONE_TRIANGLE = TriangleMesh(np.eye(3, dtype=np.float32)[None], np.full((1, 3, 3), 3 ** -0.5, np.float32), {}, None, {},
                            None, np.zeros(1, np.int32), np.float32([(0, 0, 0), (1, 1, 1)]))
BRIGHTEST = 6e4              # that half floats hold
INSIDE, INSIDE_FINE = cells_inside(), cells_inside(EMISSION_SIZE)
QUARTERS = np.float32([  # weights of corners at those of the quarters of a triangle, so that their texels are its own
    [(2, 0, 0), (1, 1, 0), (1, 0, 1)], [(1, 1, 0), (0, 2, 0), (0, 1, 1)], [(1, 0, 1), (0, 1, 1), (0, 0, 2)],
    [(0, 1, 1), (1, 0, 1), (1, 1, 0)]]) / 2
NO_LATENT = (0.0,) * 9
# Of a tile (model/scene.py)
BESIDE = Channels(1, translucent=3, fibre=1, clear=3, sheen=len(SHEEN), coat=len(COAT), guessed=1, single=1)
OPAQUE = np.zeros(len(BESIDE), np.float32)


class MaterialTiles:
    """Collects the tiles of one conversion; equal homogeneous materials share a tile."""

    def __init__(self, report, baker=None, keeps_lobes: bool = False):
        """keeps_lobes: `two_lobes` will be shown, so that one surface in their place is no approximation."""
        self.report, self.baker, self.keeps_lobes = report, baker, keeps_lobes
        self._chunks: list[np.ndarray] = []
        self._latents: list[np.ndarray] = []
        self._beside: list[np.ndarray] = []  # (T, len(BESIDE))
        self._lobes: list[np.ndarray | int] = []  # of a chunk, or how many tiles it has without any
        self._emission: list[np.ndarray] = []
        self._count = 0
        self._constant: dict[tuple, int] = {}
        self._differs_by_instance: set[Material] = set()  # those whose tiles differ by instance
        self._differs_by_scale: set[Material] = set()  # those whose tiles differ by size
        self._varying: set[Material] = set()  # those that are not the same all over some triangle
        self._differs_by_ray: set[Material] = set()  # those that rays may see differently
        self._differs_by_side: set[Material] = set()  # those whose backs are different

    @property
    def tiles(self) -> np.ndarray:
        """(T, 11, 32, 32) f16, the rows that the returned tile indices mean."""
        empty = np.zeros((0, TILE_CHANNELS, TILE_SIZE, TILE_SIZE), np.float16)
        return np.concatenate([empty, *self._chunks])

    @property
    def latents(self) -> np.ndarray | None:
        """(T, 9) f32 of these tiles, 0 where a material has none; None where none has one."""
        latents = np.concatenate([np.zeros((0, len(NO_LATENT)), np.float32), *self._latents])
        return latents if latents.any() else None

    @property
    def beside(self) -> dict[str, np.ndarray | None]:
        """Fields of a RenderScene by the names of BESIDE, (T,) or (T, C) f32; None where all are 0."""
        every = np.concatenate([np.zeros((0, len(BESIDE)), np.float32), *self._beside])
        values = {name: every[:, BESIDE[name]] for name in BESIDE.parts}
        return {name: (x if x.shape[1] > 1 else x[:, 0]) if x.any() else None for name, x in values.items()}

    @property
    def two_lobes(self) -> np.ndarray | None:
        """(T, 7, 32, 32) f16 of these tiles (model/scene.py), 0 where a material has none; None where none has them."""
        if all(isinstance(chunk, int) for chunk in self._lobes):
            return None
        side = len(TWO_LOBES), TILE_SIZE, TILE_SIZE
        return np.concatenate([np.zeros((chunk, *side), np.float16) if isinstance(chunk, int) else chunk
                               for chunk in self._lobes])

    def triangle_tiles(self, material: Material | None, mesh: TriangleMesh, instance: Instance | None = None,
                       ray: Ray = Ray.DIFFUSE, clear: float = CLEAR,
                       is_behind: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Tiles and emission of n triangles with one material, as a ray of this kind meets them, or their backs.

        Returns tile index (n,) i32, -1 where more than `clear` of the light goes straight through, and radiance (n, 3)
        f32. A homogeneous material has one tile, one with textures a tile per triangle. `sharing` says afterwards which
        other instances have the same tiles.
        """
        n = len(mesh)
        emission = np.zeros((n, 3), np.float32)
        if n == 0:
            return np.zeros(0, np.int32), emission
        if material is None:
            return np.full(n, self.constant_index(constant_tile()), np.int32), emission
        index, nothing = np.empty(n, np.int32), np.zeros(n, bool)
        chunk = BAKED_CHUNK if self.baker else CHUNK
        for start in range(0, n, chunk):
            part = slice(start, min(start + chunk, n))
            with progress.part(start / n, part.stop / n):
                progress.report()
                points = surface_points(mesh.take(part), instance or Instance(), ray=ray, is_behind=is_behind)
                surface, height = self.evaluate(material, points)
                lobes = two_lobes(material, points)
            emission[part] = self.report.finite(material.name, "its emission", mean_over_triangle(surface.emission))
            tiles = self.report.finite(material.name, "its surface", tile_arrays(surface, height))
            each = [mean_over_triangle(surface.clear) if name == "clear" else mean_of_solid(
                getattr(surface, name), surface.clear) for name in BESIDE.parts]
            beside = np.atleast_2d(self.report.finite(material.name, "its transparency", joined(*each)))
            straight = beside[:, BESIDE["clear"]]
            own = None if lobes is None else lobe_arrays(lobes, len(tiles))
            if own is not None and len(own) > len(tiles):  # only what the surface is made of in between is the same
                tiles = np.repeat(tiles, len(own), axis=0)
            nothing[part] = straight.mean(axis=-1) > clear
            if not is_homogeneous(surface):
                self._varying.add(material)
            if len(tiles) == 1 and part.stop - start > 1 and surface.emission.ndim == 1 and surface.clear.ndim == 1:
                index[:] = self.constant_index(tiles[0], material.latent, own, beside[0])
                emission[:], nothing[:] = emission[start], nothing[start]
                break
            if len(tiles) == 1:
                index[part] = self.constant_index(tiles[0], material.latent, own, beside.mean(axis=0))
            else:
                index[part] = np.arange(self._count, self._count + len(tiles))
                self._append(tiles, material.latent, own, beside)
        emission[_is_negligible(emission.max(axis=1), areas(mesh.corners))] = 0
        index[nothing & ~emission.any(axis=1)] = -1
        return index, emission

    @property
    def emission_tiles(self) -> np.ndarray | None:
        """(S, 3, 64, 64) f16, the rows that `emission_index` means; None where there are none."""
        return np.stack(self._emission) if self._emission else None

    def emission_index(self, material: Material | None, mesh: TriangleMesh, instance: Instance,
                       radiance: np.ndarray) -> np.ndarray:
        """(n,) i32 rows of `emission_tiles` of triangles that emit (n, 3), as `triangle_tiles` says; -1 where evenly.
        """
        index, rows = np.full(len(mesh), -1, np.int32), np.flatnonzero(radiance.any(axis=1))
        if material not in self._varying or not 0 < len(rows) <= MOST_PICTURES:
            return index
        for some in np.split(rows, range(CHUNK, len(rows), CHUNK)):
            progress.report()
            emission = self._fine_emission(material, mesh.take(some), instance)
            if emission is None:
                continue
            mean = radiance[some, None, None]
            for row, share in zip(some, emission / np.where(mean > 0, mean, np.inf), strict=True):
                if np.ptp(share[INSIDE_FINE], axis=0).max() > UNEVEN:
                    index[row] = len(self._emission)
                    self._emission.append(np.moveaxis(share, -1, 0).clip(0, BRIGHTEST).astype(np.float16))
        return index

    def _fine_emission(self, material: Material, mesh: TriangleMesh, instance: Instance) -> np.ndarray | None:
        """(m, 64, 64, 3) radiance of triangles, on a grid twice as fine as that of tiles; None where all are even."""
        quarters = []
        for weights in QUARTERS:
            quarter = mesh.mapped(lambda values, weights=weights: weights @ values)
            emission = self.evaluate(material, surface_points(quarter, instance))[0].emission
            if emission.ndim == 1 or emission.shape[1] == 1:
                return None
            quarters.append(np.nan_to_num(emission).clip(0))
        return _fine_grid(*quarters)

    def shows_through(self, material, mesh: TriangleMesh, instance: Instance, smooth: float) -> np.ndarray:
        """(n,) share of light that goes straight, or through glass of at most the roughness `smooth`, at triangles."""
        if material is None:
            return np.zeros(len(mesh))
        surface, _ = self.evaluate(material, surface_points(mesh, instance, ray=Ray.CAMERA))
        straight = surface.clear.mean(axis=-1, keepdims=True)
        through = straight + (1 - straight) * surface.transmission * (surface.roughness <= smooth)
        return np.broadcast_to(mean_over_triangle(through)[..., 0], len(mesh))

    def cuts_holes(self, material: Material | None, mesh: TriangleMesh, instance: Instance) -> np.ndarray:
        """(n,) bool: triangles most of which is cut out of the film."""
        if material is None or not graph.has_node(material.node_tree, "ShaderNodeHoldout"):
            return np.zeros(len(mesh), bool)
        surface, _ = self.evaluate(material, surface_points(mesh, instance, ray=Ray.CAMERA))
        return np.broadcast_to(mean_over_triangle(surface.holdout)[..., 0] > 0.5, len(mesh))

    def varies(self, material: Material | None) -> bool:
        """Whether it was not the same all over some triangle, or not the same for all rays."""
        return material in self._varying or self.differs_by_ray(material)

    def differs_by_ray(self, material: Material | None) -> bool:
        """Whether what a ray meets may depend on what it is for."""
        return material in self._differs_by_ray

    def differs_by_side(self, material: Material | None) -> bool:
        """Whether the backs of faces may be different."""
        return material in self._differs_by_side

    def evaluate(self, material: Material, points: Points) -> tuple[SurfaceParameters, np.ndarray]:
        """The surface and its height, in the units of a tile, at these points."""
        tree = material.node_tree
        if tree is None:
            color = np.array(material.diffuse_color[:3], np.float32)
            return parameters(lobe(color)), np.zeros(1, np.float32)
        evaluator = Evaluator(points, tree.conventions, self.report, material.name, self.baker)
        evaluator.material_index = material.pass_index
        output = graph.output_node(tree)
        output = None if output is None else NodeCall(evaluator, output)
        evaluator.keeps_lobes = self.keeps_lobes and output is not None and lobe_nodes(output) is not None
        closure = Closure() if output is None else closure_at(output, "Surface")
        if evaluator.depends_on_ray:
            self._differs_by_ray.add(material)
        if evaluator.depends_on_side:
            self._differs_by_side.add(material)
        if (closure.emission < 0).any():
            self.report.approximated(material.name, "negative light is ignored")
        if not evaluator.has_shader and has_surface(material):
            self.report.approximated(material.name, "no surface shader is connected to the Material Output, so it is "
                                                    "black")
        displacement, surface = _displacement(material, output), parameters(closure)
        if material.displacement_method == "BUMP" and displacement.ndim > 1:
            surface.normal = bend_normal(output, surface.normal, displacement)
            displacement = np.zeros(1, np.float32)
        if evaluator.depends_on_instance:
            self._differs_by_instance.add(material)
        if evaluator.depends_on_scale:
            self._differs_by_scale.add(material)
        return surface, np.clip(displacement / HEIGHT_UNIT, -1, 1)

    def sharing(self, material, instance: Instance):
        """A key that is equal for instances with the same tiles of a material; call `triangle_tiles` first."""
        if material in self._differs_by_instance:
            return id(instance)
        if material in self._differs_by_scale:
            linear = instance.matrix[:3, :3]
            return tuple(np.round(linear.T @ linear, SCALE_DIGITS).ravel())
        return None

    def constant_index(self, tile: np.ndarray, latent: tuple[float, ...] | None = None,
                       lobes: np.ndarray | None = None, beside: np.ndarray = OPAQUE) -> int:
        """The row of a tile (11, 32, 32) f16, one for all that are equal; beside: (len(BESIDE),)."""
        key = tile.tobytes(), latent, lobes if lobes is None else lobes.tobytes(), tuple(map(float, beside))
        if key not in self._constant:
            self._constant[key] = self._count
            self._append(tile[None], latent, lobes, beside)
        return self._constant[key]

    def _append(self, tiles: np.ndarray, latent: tuple[float, ...] | None, lobes: np.ndarray | None,
                beside: np.ndarray) -> None:
        self._beside.append(np.broadcast_to(np.float32(beside), (len(tiles), len(OPAQUE))))
        self._lobes.append(len(tiles) if lobes is None else lobes)
        self._chunks.append(tiles)
        self._latents.append(np.tile(np.float32(latent or NO_LATENT), (len(tiles), 1)))
        self._count += len(tiles)


class _BakerProbe:
    """Stands in for a baker and remembers whether it was needed."""

    was_needed = False

    def bake(self, n):
        self.was_needed = True
        raise RuntimeError("it is baked later")


def needs_baking(material: Material) -> bool:
    """Whether it has nodes that a baker has to evaluate."""
    probe = _BakerProbe()
    MaterialTiles(Report(), probe).triangle_tiles(material, ONE_TRIANGLE)
    return probe.was_needed


def _displacement(material, output: NodeCall | None) -> np.ndarray:
    """World units along the normal, by what reaches the Displacement input."""
    n = None if output is None else output.source("Displacement")
    if n is None or n.points.is_displaced:
        return np.zeros(1, np.float32)
    if n.kind != "ShaderNodeDisplacement":
        n.approximated("its displacement is ignored")
        return np.zeros(1, np.float32)
    height = (n["Height"] - n["Midlevel"]) * n["Scale"]
    return height * _normal_scale(n) if n.node.space == "OBJECT" else height


def _normal_scale(n: NodeCall) -> np.ndarray:
    """(1,), or (m, 1, 1, 1) of an object scaled unevenly: how much its matrix lengthens the normal of a triangle."""
    linear = n.linear_matrix()
    scale = np.linalg.svd(linear, compute_uv=False)
    if np.ptp(scale) < 1e-3 * scale.max():
        return scale[:1].astype(np.float32)
    normals = face_normals(n.points.corners)
    return np.linalg.norm(normals @ linear.T, axis=1).astype(np.float32)[:, None, None, None]


def _is_negligible(radiance: np.ndarray, area: np.ndarray) -> np.ndarray:
    """(n,) bool: the triangles with the least radiance (n,), as many as are dark and give hardly any of the light."""
    power, order = radiance * area, np.argsort(radiance, kind="stable")
    share = np.empty_like(power)
    share[order] = np.cumsum(power[order])
    return (radiance < DARK_FRACTION * radiance.max(initial=0)) & (share <= DARK_FRACTION * power.sum())


def is_homogeneous(surface: SurfaceParameters) -> bool:
    """Whether it is the same at all points."""
    return all(getattr(surface, f.name).ndim == 1 for f in fields(surface))


def bsdf_parameters(surface: SurfaceParameters) -> tuple[tuple[int | slice, np.ndarray], ...]:
    """Values by their channels of a tile."""
    return ((BASE_COLOR, surface.base_color), (METALLIC, surface.metallic), (ROUGHNESS, surface.roughness),
            (IOR, surface.ior), (TRANSMISSION, surface.transmission))


def tile_arrays(surface: SurfaceParameters, height: np.ndarray) -> np.ndarray:
    """(m, 11, 32, 32) f16, m = 1 when no parameter varies over the surface."""
    placed = (*bsdf_parameters(surface), (NORMAL, surface.normal), (HEIGHT, height))
    count = max(len(values) if values.ndim > 1 else 1 for _, values in placed)
    tiles = np.empty((count, TILE_CHANNELS, TILE_SIZE, TILE_SIZE), np.float16)
    for channel, values in placed:
        channels = slice(channel, channel + 1) if isinstance(channel, int) else channel
        full = np.broadcast_to(values, (count, TILE_SIZE, TILE_SIZE, values.shape[-1]))
        tiles[:, channels] = np.moveaxis(full, -1, 1)
    return tiles


def lobe_arrays(lobes: dict[str, np.ndarray], count: int) -> np.ndarray:
    """(m, 7, 32, 32) f16 of the result of `two_lobes`, m = `count` of tiles if nothing varies over the surface."""
    named = {name: lobes[name] for name in TWO_LOBES.parts}
    count = max([count] + [len(values) for values in named.values() if values.ndim > 1])
    arrays = np.empty((count, len(TWO_LOBES), TILE_SIZE, TILE_SIZE), np.float16)
    for name, values in named.items():
        full = np.broadcast_to(values, (count, TILE_SIZE, TILE_SIZE, values.shape[-1]))
        arrays[:, TWO_LOBES[name]] = np.moveaxis(full, -1, 1)
    return arrays


def _fine_grid(first: np.ndarray, second: np.ndarray, third: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """(m, 64, 64, 3) values on triangles of those (m, 32, 32, 3) on their QUARTERS.

    Those at the borders are of the texels before: at the very edge of an image its other edge begins.
    """
    fine = np.zeros((len(first), EMISSION_SIZE, EMISSION_SIZE, 3), np.float32)
    fine[:, :TILE_SIZE, TILE_SIZE:], fine[:, TILE_SIZE:, :TILE_SIZE] = first, second
    fine[:, :TILE_SIZE, :TILE_SIZE] = np.where(INSIDE[..., None], third, middle[:, ::-1, ::-1])
    row = np.arange(EMISSION_SIZE)
    column = row[::-1]
    fine[:, row, column] = fine[:, row - (row > column), column - (row < column)]
    fine[:, 0], fine[:, :, 0] = fine[:, 1], fine[:, :, 1]
    fine[:, 0, -1], fine[:, -1, 0] = fine[:, 0, -2], fine[:, -2, 0]
    return fine


def mean_over_triangle(values: np.ndarray) -> np.ndarray:
    """(c,) or (m, 32, 32, c) -> (c,) or (m, c): mean over the cells inside the triangle. (m, 1, 1, c): it is even."""
    if values.ndim == 1:
        return values
    if values.shape[1:3] == (1, 1):
        return values[:, 0, 0]
    return values[:, INSIDE].mean(axis=1)


def mean_of_solid(values: np.ndarray, clear: np.ndarray) -> np.ndarray:
    """The same of a surface of which a share, values (3,) or (m, 32, 32, 3), is `clear`: by how much of it is there."""
    if values.ndim == 1 or clear.ndim == 1:
        return mean_over_triangle(values)
    solid = (1 - clear.mean(axis=-1, keepdims=True)).clip(LEAST_SOLID)
    return mean_over_triangle(values * solid) / mean_over_triangle(solid)
