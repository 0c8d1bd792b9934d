# SPDX-License-Identifier: GPL-3.0-or-later
"""Convert materials to tiles and emission of triangles (docs/scene-input.md 3, 4)."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ....model import progress
from ....model.fields import Channels
from ....model.scene import COAT, SHEEN, TILE_CHANNELS, TILE_SIZE, TWO_LOBES, constant_tile
from ....model.surface_kinds import Ray
from ..data.blocks import Material
from ..data.copied import Instance
from ..data.mesh import TriangleMesh, areas
from ..data.report import Report
from . import graph
from .closure import SurfaceParameters, joined
from .material import evaluate_material
from .points import Points, surface_points
from .tile_arrays import (
    INSIDE_FINE,
    QUARTERS,
    is_homogeneous,
    join_quarters,
    lobe_arrays,
    mean_of_solid,
    mean_over_triangle,
    tile_arrays,
)
from .two_lobes import two_lobes

SCALE_DIGITS = 3             # squares of sizes that differ by less are the same
CHUNK = 256                  # triangles evaluated at once
BAKED_CHUNK = 1024           # and where some may be baked, for which Cycles reads the whole scene each time
EMITTER_RADIANCE = 1.0       # from here on the own light of a surface outshines what it reflects
DARK_FRACTION = 0.01         # of an emission texture: darker triangles do not shine if all are as small a share of it
CLEAR = 0.95                 # a triangle that lets more light straight through than this is left out
UNEVEN = 0.05                # of the mean emission of a triangle: it is a picture where it differs by more
MOST_PICTURES = 256          # triangles of a mesh with one; a finer mesh shows it by its triangles
BRIGHTEST = 6e4              # that half floats hold
NO_LATENT = (0.0,) * 9
# Of a tile, one value for all its texels (model/scene.py)
EXTRAS = Channels(1, translucent=3, fibre=1, clear=3, sheen=len(SHEEN), coat=len(COAT), guessed=1, single=1)
OPAQUE = np.zeros(len(EXTRAS), np.float32)


class _ShadedTriangles(NamedTuple):
    """Some triangles with one material; one row stands for all where they are alike."""

    tiles: np.ndarray         # (m, 11, 32, 32) f16
    extras: np.ndarray        # (m, len(EXTRAS)) f32
    lobes: np.ndarray | None  # (m, 7, 32, 32) f16
    emission: np.ndarray      # (3,) or (m, 3) f32, radiance
    is_even: bool             # emission and transparency are the same all over them


class MaterialTiles:
    """Collects the tiles of one conversion; equal homogeneous materials share a tile."""

    def __init__(self, report: Report, baker=None, keeps_lobes: bool = False):
        """keeps_lobes: `two_lobes` will be shown, so that one surface in their place is no approximation."""
        self.report, self.baker, self.keeps_lobes = report, baker, keeps_lobes
        self._chunks: list[np.ndarray] = []
        self._latents: list[np.ndarray] = []
        self._extras: list[np.ndarray] = []  # (T, len(EXTRAS))
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
    def extras(self) -> dict[str, np.ndarray | None]:
        """Fields of a RenderScene by the names of EXTRAS, (T,) or (T, C) f32; None where all are 0."""
        every = np.concatenate([np.zeros((0, len(EXTRAS)), np.float32), *self._extras])
        values = {name: every[:, EXTRAS[name]] for name in EXTRAS.parts}
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
        index, is_clear = np.empty(n, np.int32), np.zeros(n, bool)
        chunk = BAKED_CHUNK if self.baker else CHUNK
        for start in range(0, n, chunk):
            rows = slice(start, min(start + chunk, n))
            with progress.part(start / n, rows.stop / n):
                progress.report()
                shaded = self._shade(material, surface_points(mesh.take(rows), instance or Instance(), ray=ray,
                                                              is_behind=is_behind))
            emission[rows] = shaded.emission
            is_clear[rows] = shaded.extras[:, EXTRAS["clear"]].mean(axis=-1) > clear
            if len(shaded.tiles) > 1:
                index[rows] = np.arange(self._count, self._count + len(shaded.tiles))
                self._append(shaded.tiles, material.latent, shaded.lobes, shaded.extras)
                continue
            is_uniform = shaded.is_even and rows.stop - start > 1
            extras = shaded.extras[0] if is_uniform else shaded.extras.mean(axis=0)
            tile = self.constant_index(shaded.tiles[0], material.latent, shaded.lobes, extras)
            if is_uniform:
                index[:], emission[:], is_clear[:] = tile, emission[start], is_clear[start]
                break
            index[rows] = tile
        emission[_is_negligible(emission.max(axis=1), areas(mesh.corners))] = 0
        index[is_clear & ~emission.any(axis=1)] = -1
        return index, emission

    def _shade(self, material: Material, points: Points) -> _ShadedTriangles:
        surface, height = self._evaluate(material, points)
        lobes = two_lobes(material, points)
        emission = self.report.finite(material.name, "its emission", mean_over_triangle(surface.emission))
        tiles = self.report.finite(material.name, "its surface", tile_arrays(surface, height))
        means = [mean_over_triangle(surface.clear) if name == "clear" else mean_of_solid(
            getattr(surface, name), surface.clear) for name in EXTRAS.parts]
        extras = np.atleast_2d(self.report.finite(material.name, "its transparency", joined(*means)))
        arrays = None if lobes is None else lobe_arrays(lobes, len(tiles))
        if arrays is not None and len(arrays) > len(tiles):  # only what the surface is made of in between is the same
            tiles = np.repeat(tiles, len(arrays), axis=0)
        if not is_homogeneous(surface):
            self._varying.add(material)
        return _ShadedTriangles(tiles, extras, arrays, emission, surface.emission.ndim == surface.clear.ndim == 1)

    def _evaluate(self, material: Material, points: Points) -> tuple[SurfaceParameters, np.ndarray]:
        """The surface and its height; what they depend on is remembered."""
        evaluated = evaluate_material(material, points, self.report, self.baker, self.keeps_lobes)
        for is_dependent, materials in ((evaluated.depends_on_ray, self._differs_by_ray),
                                        (evaluated.depends_on_side, self._differs_by_side),
                                        (evaluated.depends_on_instance, self._differs_by_instance),
                                        (evaluated.depends_on_scale, self._differs_by_scale)):
            if is_dependent:
                materials.add(material)
        return evaluated.surface, evaluated.height

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
            emission = self._evaluate(material, surface_points(quarter, instance))[0].emission
            if emission.ndim == 1 or emission.shape[1] == 1:
                return None
            quarters.append(np.nan_to_num(emission).clip(0))
        return join_quarters(*quarters)

    def cuts_holes(self, material: Material | None, mesh: TriangleMesh, instance: Instance) -> np.ndarray:
        """(n,) bool: triangles most of which is cut out of the film."""
        if material is None or not graph.has_node(material.node_tree, "ShaderNodeHoldout"):
            return np.zeros(len(mesh), bool)
        surface, _ = self._evaluate(material, surface_points(mesh, instance, ray=Ray.CAMERA))
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

    def sharing(self, material, instance: Instance):
        """A key that is equal for instances with the same tiles of a material; call `triangle_tiles` first."""
        if material in self._differs_by_instance:
            return id(instance)
        if material in self._differs_by_scale:
            linear = instance.matrix[:3, :3]
            return tuple(np.round(linear.T @ linear, SCALE_DIGITS).ravel())
        return None

    def constant_index(self, tile: np.ndarray, latent: tuple[float, ...] | None = None,
                       lobes: np.ndarray | None = None, extras: np.ndarray = OPAQUE) -> int:
        """The row of a tile (11, 32, 32) f16, one for all that are equal; extras: (len(EXTRAS),)."""
        key = tile.tobytes(), latent, lobes if lobes is None else lobes.tobytes(), tuple(map(float, extras))
        if key not in self._constant:
            self._constant[key] = self._count
            self._append(tile[None], latent, lobes, extras)
        return self._constant[key]

    def _append(self, tiles: np.ndarray, latent: tuple[float, ...] | None, lobes: np.ndarray | None,
                extras: np.ndarray) -> None:
        self._extras.append(np.broadcast_to(np.float32(extras), (len(tiles), len(OPAQUE))))
        self._lobes.append(len(tiles) if lobes is None else lobes)
        self._chunks.append(tiles)
        self._latents.append(np.tile(np.float32(latent or NO_LATENT), (len(tiles), 1)))
        self._count += len(tiles)


def _is_negligible(radiance: np.ndarray, area: np.ndarray) -> np.ndarray:
    """(n,) bool: the triangles with the least radiance (n,), as many as are dark and give hardly any of the light."""
    power, order = radiance * area, np.argsort(radiance, kind="stable")
    share = np.empty_like(power)
    share[order] = np.cumsum(power[order])
    return (radiance < DARK_FRACTION * radiance.max(initial=0)) & (share <= DARK_FRACTION * power.sum())
