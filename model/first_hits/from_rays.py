# SPDX-License-Identifier: GPL-3.0-or-later
"""First hits of our own rays alone: guides for any camera, without Cycles."""
from __future__ import annotations

import numpy as np

from ..geometry import corner_weights, seen_in
from ..material.reflectance import normal_reflectance
from ..scene import BASE_COLOR, IOR, METALLIC, TRANSMISSION, Guides, RenderScene, View, texels, tint_of_glass
from ..shading import on_tokens, shading_normals

OF_PLACE = "position", "normal", "depth", "hit_triangle", "hit_barycentric", "material"
OF_ALL = "diffuse_color", "glossy_color", "transmission_color", "emission", "environment", "alpha"
NOTHING_HIT = 1e10  # depth there, as Blender has it


def guides_of_hits(scene: RenderScene, view: View, rays: np.ndarray, triangle: np.ndarray,
                   weights: np.ndarray) -> Guides:
    """Guides of one view from what its rays hit: one sample per pixel, materials as the token's tile has them.

    rays (H, W, 3) unit, world; triangle (H, W) i32 of the geometry, -1 = nothing; weights (H, W, 2) of its corners 0
    and 1. Colours leave out how reflection grows towards grazing angles; normals face the viewer.
    """
    hit = triangle >= 0
    at = np.flatnonzero(hit)
    environment = np.zeros((triangle.size, 3), np.float32)
    position, normal, emission = (np.zeros_like(environment) for _ in range(3))
    token, on_token = np.full(triangle.size, -1, np.int32), np.zeros((triangle.size, 2), np.float32)
    depth, color = np.full(triangle.size, NOTHING_HIT, np.float32), np.zeros((3, *environment.shape), np.float32)
    flat_rays = rays.reshape(-1, 3)
    if len(at):
        row, hit_weights, camera = triangle.ravel()[at], weights.reshape(-1, 2)[at], view.camera_to_world
        share = corner_weights(hit_weights)
        position[at] = np.einsum("pk,pkc->pc", share, scene.surfaces.triangles[row])
        normal[at] = shading_normals(scene, row, share, flat_rays[at])
        depth[at] = (position[at] - camera[:3, 3]) @ -camera[:3, 2]
        token[at], on_token[at] = on_tokens(scene, row, hit_weights)
        emission[at] = scene.emission[token[at]]
        color[:, at] = lobe_colors(scene, token[at], on_token[at])
    if scene.environment is not None:
        sky = np.flatnonzero(~hit)
        environment[sky] = seen_in(scene.environment, flat_rays[sky])
    whole = lambda array: array.reshape(*array.shape[:-2], *triangle.shape, 3)  # noqa: E731
    return Guides(whole(position), whole(normal), *whole(color), whole(emission), whole(environment),
                  depth.reshape(triangle.shape), hit.astype(np.float32), token.reshape(triangle.shape),
                  on_token.reshape(weights.shape))


def mean_guides(parts: list[Guides]) -> Guides:
    """Of several samples of each pixel: means of colours and coverage, and the place and surface of the first hit."""
    if len(parts) == 1:
        return parts[0]
    first = np.argmax([part.alpha > 0 for part in parts], axis=0)[None]

    def of_first(name: str) -> np.ndarray:
        values = np.stack([getattr(part, name) for part in parts])
        return np.take_along_axis(values, first.reshape(*first.shape, *(1,) * (values.ndim - 3)), axis=0)[0]
    return Guides(**{name: of_first(name) for name in parts[0].arrays() if name in OF_PLACE},
                  **{name: np.mean([getattr(part, name) for part in parts], axis=0) for name in OF_ALL})


def lobe_colors(scene: RenderScene, row: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(3, P, 3) diffuse, glossy and transmission colour of tokens (P,) at normal incidence; emitters reflect none."""
    x, y = texels(weights)
    return colors_of_texels(scene.tiles[scene.tile_index[row], :, y, x].astype(np.float32)) * ~scene.is_light[row, None]


def colors_of_texels(texel: np.ndarray) -> np.ndarray:
    """(3, P, 3) diffuse, glossy and transmission colour of material texels (P, C) at normal incidence."""
    base, metallic, transmission = texel[:, BASE_COLOR], texel[:, METALLIC, None], texel[:, TRANSMISSION, None]
    specular = normal_reflectance(texel[:, IOR, None])
    dielectric = 1 - metallic
    return np.stack([base * dielectric * (1 - transmission), base * metallic + specular * dielectric,
                     tint_of_glass(base) * dielectric * transmission])
