# SPDX-License-Identifier: GPL-3.0-or-later
"""First hits of our own rays alone: guides for any camera, without Cycles."""
from __future__ import annotations

import numpy as np

from ..geometry import corner_weights, dot, interpolated
from ..material.reflectance import normal_reflectance
from ..scene import (
    BASE_COLOR,
    IOR,
    METALLIC,
    PARAMETERS,
    TRANSMISSION,
    Guides,
    RenderScene,
    View,
    texels,
    tint_of_glass,
)
from ..shading import on_tokens, seen_sky, shading_normals
from ..surface_kinds import Ray
from .at_pixels import Materials, appearance
from .seen_colors import seen_colors

NOTHING_HIT = 1e10  # depth there, as Blender has it
EVEN = 0.02         # difference from the neighbours up to which all samples of a pixel have the colours of the first
UNLIKE = -2         # material of emitters, which are like nothing else
COLORS = "diffuse_color", "glossy_color", "transmission_color", "emission"


class AccumulatedGuides:
    """Guides of one view of a scene, accumulated over samples of all its pixels.

    Places are those of the first sample that hits anything, colours are means; normals face the viewer.
    """

    def __init__(self, scene: RenderScene, view: View, materials: Materials | None = None):
        """materials: to be evaluated at pixels; without them, the tiles of tokens are read."""
        self._scene, self._view, self._materials, self._count = scene, view, materials, 0
        shape = view.height, view.width
        black = lambda: np.zeros((*shape, 3), np.float32)  # noqa: E731
        self._guides = Guides(*(black() for _ in range(7)), np.full(shape, NOTHING_HIT, np.float32),
                              np.zeros(shape, np.float32), np.full(shape, -1, np.int32),
                              np.zeros((*shape, 2), np.float32))
        # Of the first sample: colours of lobes and emission (4, H W, 3), and materials (H W,)
        self._first: tuple[np.ndarray, np.ndarray] | None = None
        self._is_even: np.ndarray | None = None  # (H W,) pixels with the material and colour of their neighbours in it

    def add(self, rays: np.ndarray, triangle: np.ndarray, weights: np.ndarray) -> None:
        """A sample of each pixel.

        rays (H, W, 3) unit, world; triangle (H, W) i32 of the geometry, -1 = nothing; weights (H, W, 2) of its corners
        0 and 1.
        """
        triangle, weights, self._count = triangle.ravel(), weights.reshape(-1, 2), self._count + 1
        is_hit = triangle >= 0
        at = np.flatnonzero(is_hit & (self._flat("alpha") == 0))
        self._place(at, rays, triangle[at], weights[at])
        self._flat("alpha")[is_hit] += 1
        sky = np.flatnonzero(~is_hit)
        self._flat("environment")[sky] += seen_sky(self._scene, rays.reshape(-1, 3)[sky], Ray.CAMERA)
        colors = self._colors(rays, triangle, weights)
        for name, values in zip(COLORS, colors, strict=True):
            total = self._flat(name)
            total += values

    def guides(self) -> Guides:
        """The means over the samples; none can be added afterwards."""
        for name in (*COLORS, "environment", "alpha"):
            values = getattr(self._guides, name)
            values /= max(self._count, 1)
        return self._guides

    def _flat(self, name: str) -> np.ndarray:
        """(H W, ...) view of the memory of a guide."""
        values = getattr(self._guides, name)
        return values.reshape(self._view.height * self._view.width, *values.shape[2:])

    def _place(self, at: np.ndarray, rays: np.ndarray, row: np.ndarray, weights: np.ndarray) -> None:
        """Write position, normal, depth and token of pixels by number (P,)."""
        scene, camera, share = self._scene, self._view.camera_to_world, corner_weights(weights)
        position = interpolated(share, scene.surfaces.triangles[row])
        self._flat("position")[at] = position
        self._flat("normal")[at] = shading_normals(scene, row, share, rays.reshape(-1, 3)[at])
        self._flat("depth")[at] = (position - camera[:3, 3]) @ -camera[:3, 2]
        self._flat("hit_triangle")[at], self._flat("hit_barycentric")[at] = on_tokens(scene, row, weights)

    def _colors(self, rays: np.ndarray, triangle: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """(4, H W, 3) of the lobes, and emission.

        Where a pixel is like its neighbours, samples that hit the material of its first one have the colours of that.
        """
        group = None if self._materials is None else self._materials.groups(triangle)
        colors, material_id = np.zeros((4, len(triangle), 3), np.float32), self._material_ids(triangle, group)
        is_open = triangle >= 0
        if self._first is not None:
            first, first_id = self._first
            if self._is_even is None:
                self._is_even = _is_even(first, first_id, self._guides.alpha.shape)
            is_known = self._is_even & (material_id == first_id)
            colors[:, is_known] = first[:, is_known]
            is_open &= ~is_known
        if group is not None:
            at = np.flatnonzero(is_open & (group >= 0))
            if len(at):
                is_open[self._evaluate(colors, at, rays, triangle[at], weights[at])] = False
        at = np.flatnonzero(is_open)
        token, on_token = self._tokens(at, triangle[at], weights[at])
        tile, normal = self._scene.seen_tile[token], self._normals(at, rays, triangle[at], weights[at])
        seen = self._seen(texels_of_tiles(self._scene, tile, on_token), normal, rays.reshape(-1, 3)[at], tile)
        colors[:3, at] = seen * ~self._scene.is_light[token, None]
        colors[3, at] = self._scene.emission[token] + self._scene.surface_glow[token]
        if self._first is None:
            self._first = colors, material_id
        return colors

    def _material_ids(self, triangle: np.ndarray, group: np.ndarray | None) -> np.ndarray:
        """(H W,) i32, equal for hits on one material, or on one tile."""
        scene = self._scene
        if not len(scene):
            return np.full(len(triangle), -1, np.int32)
        token = scene.surfaces.token[triangle.clip(0)]
        material_id = np.where(scene.is_light, UNLIKE, scene.seen_tile)[token]
        if group is not None:
            material_id = np.where(group >= 0, len(scene.tiles) + group, material_id)
        return np.where(triangle >= 0, material_id, -1)

    def _tokens(self, at: np.ndarray, triangle: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if self._first is None:
            return self._flat("hit_triangle")[at], self._flat("hit_barycentric")[at]
        return on_tokens(self._scene, triangle, weights)

    def _normals(self, at: np.ndarray, rays: np.ndarray, triangle: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """(P, 3) shading normals of pixels by number (P,)."""
        if self._first is None:
            return self._flat("normal")[at]
        return shading_normals(self._scene, triangle, corner_weights(weights), rays.reshape(-1, 3)[at])

    def _evaluate(self, colors: np.ndarray, at: np.ndarray, rays: np.ndarray, triangle: np.ndarray,
                  weights: np.ndarray) -> np.ndarray:
        """Write the colours of pixels by number (P,), of the first sample normals and materials, too.

        Returns the pixels at which materials could be evaluated.
        """
        normal = self._normals(at, rays, triangle, weights)
        evaluated = appearance(self._scene, self._materials, self._view, rays, at, triangle, corner_weights(weights),
                               normal)
        token = self._scene.surfaces.token[triangle[evaluated.is_known]]
        at, texel, normal = (x[evaluated.is_known] for x in (at, evaluated.texel, evaluated.normal))
        colors[:3, at] = self._seen(texel, normal, rays.reshape(-1, 3)[at], self._scene.seen_tile[token])
        colors[3, at] = evaluated.emission[evaluated.is_known]
        if self._first is None:
            self._guides.material = material_of_tokens(self._scene, self._guides)
            self._flat("material")[at], self._flat("normal")[at] = texel, normal
        return at

    def _seen(self, texel: np.ndarray, normal: np.ndarray, rays: np.ndarray, tile: np.ndarray) -> np.ndarray:
        """(3, P, 3) colours of material texels (P, C) with normals (P, 3), as unit rays (P, 3) see them."""
        return seen_colors(colors_of_texels(texel), texel, -dot(normal, rays).clip(-1, 0), self._scene, tile)


def _is_even(colors: np.ndarray, material_id: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """(H W,) bool: pixels whose four neighbours have the same material (H W,) and similar colours (4, H W, 3)."""
    material_id, is_even = material_id.reshape(shape), np.ones(shape, bool)
    for axis in (0, 1):
        is_same = np.diff(material_id, axis=axis) == 0
        for color in np.sqrt(colors).reshape(len(colors), *shape, 3):
            is_same &= np.abs(np.diff(color, axis=axis)).max(axis=-1) < EVEN
        for margin in ((1, 0), (0, 1)):
            is_even &= np.pad(is_same, (margin, (0, 0)) if axis == 0 else ((0, 0), margin), constant_values=True)
    return is_even.ravel() & (material_id.ravel() != UNLIKE)


def material_of_tokens(scene: RenderScene, guides: Guides) -> np.ndarray:
    """(H, W, 7) f16 `material` of guides, of the tiles."""
    x, y = texels(guides.hit_barycentric)
    return scene.tiles[scene.seen_tile[guides.hit_triangle.clip(0)], PARAMETERS, y, x]


def lobe_colors(scene: RenderScene, row: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(3, P, 3) diffuse, glossy and transmission colour of tokens (P,) at normal incidence; emitters reflect none."""
    return colors_of_texels(texels_of_tiles(scene, scene.seen_tile[row], weights)) * ~scene.is_light[row, None]


def texels_of_tiles(scene: RenderScene, tile: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(P, C) f32 of tiles (P,), at weights (P, 2) on tokens."""
    x, y = texels(weights)
    return scene.tiles[tile, :, y, x].astype(np.float32)


def colors_of_texels(texel: np.ndarray) -> np.ndarray:
    """(3, P, 3) diffuse, glossy and transmission colour of material texels (P, C) at normal incidence."""
    base, metallic, transmission = texel[:, BASE_COLOR], texel[:, METALLIC, None], texel[:, TRANSMISSION, None]
    specular = normal_reflectance(texel[:, IOR, None])
    dielectric = 1 - metallic
    return np.stack([base * dielectric * (1 - transmission), base * metallic + specular * dielectric,
                     tint_of_glass(base) * dielectric * transmission])
