# SPDX-License-Identifier: GPL-3.0-or-later
"""The network's `Guides`: from Cycles' first-hit passes, or from the token triangles alone."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from mathutils.bvhtree import BVHTree

from ...model import denoise_media
from ...model.camera import view_rays, view_rays_at
from ...model.first_hits import guides_of_hits
from ...model.geometry import barycentric
from ...model.progress import report
from ...model.scene import Guides, RenderScene, View
from ..casting import cast, tree_of

# A pixel's ray belongs to the triangle that it hits if that hit lies within this fraction of the distance of what
# Cycles saw. Decimated meshes and displacement pass; what Cycles' camera does not see (alpha cut-outs, hidden objects)
# fails, and the triangle nearest to what it saw is taken instead.
TOLERANCE = 0.01
# Camera rays pass through lamps, which may hang just below a ceiling: a light that shows no emission must fit closely.
UNSEEN_LIGHT_TOLERANCE = 1e-4
NOTHING_HIT = 1e9    # Cycles' Depth is 1e10 where the pixel's centre hits nothing
COVERED = 1e-3       # alpha below this is not worth a token's attention
FILL_RADIUS = 4      # pixels
CHUNK = 1 << 16      # pixels between two looks at the Esc key: about 0.1 s
GRID = 4             # pixels


def cast_guides(scene: RenderScene, view: View) -> Guides:
    """First-hit guides of one view of `scene` (world frame) by rays through the pixels' centres.

    For whoever has no passes of Cycles, such as a viewport: no anti-aliasing, and nothing that is not in a token.
    """
    seen = np.flatnonzero(scene.is_seen)
    triangle = np.full(view.width * view.height, -1, np.int32)
    weights = np.zeros((view.width * view.height, 2), np.float32)
    rays = view_rays(view)[1]
    if len(seen):
        tree, eye, flat = tree_of(scene.triangles[seen]), view.camera_to_world[:3, 3], rays.reshape(-1, 3)
        for first in range(0, len(flat), CHUNK):
            report(first / len(flat), "Finding the triangles that are seen")
            found, distance = cast(tree, eye, flat[first:first + CHUNK])
            hit = np.flatnonzero(found >= 0)
            point = eye + distance[hit, None] * flat[first + hit]
            triangle[first + hit] = seen[found[hit]]
            weights[first + hit] = _weights(scene.triangles[seen[found[hit]]], point)
    return guides_of_hits(scene, view, rays, triangle.reshape(view.height, view.width),
                          weights.reshape(view.height, view.width, 2))


def make_guides(passes: dict[str, np.ndarray], scene: RenderScene, view: View) -> Guides:
    """First-hit guides of one view from `passes` (cycles_session.render_passes) and `scene` (world frame).

    Cycles gives Position for the pixel's centre only. Pixels that are partly covered although their centre hits nothing
    (silhouettes, wires) take position and triangle from the nearest covered pixel. Normals become unit vectors.

    Raises ValueError when the passes do not have the size of `view`.
    """
    alpha = passes["alpha"][..., 0].clip(0.0, 1.0)
    if alpha.shape != (view.height, view.width):
        raise ValueError(f"the passes are {alpha.shape[1]}x{alpha.shape[0]}, the view is {view.width}x{view.height}")
    covered = alpha > COVERED
    seen = covered & (passes["depth"][..., 0] < NOTHING_HIT)

    position = passes["position"] * seen[..., None]
    triangle = np.full(seen.shape, -1, np.int32)
    weights = np.zeros((*seen.shape, 2), np.float32)
    if len(scene) and seen.any():
        shines = (passes["emission"] > 0).any(axis=-1)
        triangle[seen], weights[seen] = _first_triangles(scene, view, position, seen, shines)
    source = _nearest(seen, covered)
    guides = replace(guides_of_no_triangle(passes), position=position.reshape(-1, 3)[source],
                     hit_triangle=triangle.ravel()[source], hit_barycentric=weights.reshape(-1, 2)[source])
    return denoise_media.smoothed(guides, scene.volumes, view)


def guides_of_no_triangle(passes: dict[str, np.ndarray]) -> Guides:
    """All but where things are, of `passes` (cycles_session.render_passes) that were seen from several places."""
    alpha, length = passes["alpha"][..., 0].clip(0, 1), np.linalg.norm(passes["normal"], axis=-1, keepdims=True)
    covered = (alpha > COVERED) | passes["transmission_color"].any(axis=-1)  # a denoiser spreads a little
    return Guides(
        position=np.zeros_like(passes["position"]), normal=passes["normal"] / np.where(length > 0, length, 1),
        diffuse_color=passes["diffuse_color"], glossy_color=passes["glossy_color"],
        transmission_color=passes["transmission_color"], emission=passes["emission"],
        environment=passes["environment"], depth=passes["depth"][..., 0], alpha=alpha,
        hit_triangle=np.full(alpha.shape, -1, np.int32), hit_barycentric=np.zeros((*alpha.shape, 2), np.float32),
        traced=passes["traced"] * covered[..., None] if "traced" in passes else None)


def _first_triangles(scene: RenderScene, view: View, position: np.ndarray, seen: np.ndarray,
                     shines: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Token triangle (S,) i32 and weights of its corners 0 and 1 (S, 2) f32 for the S pixels of `seen`.

    Rays are cast through every GRID-th pixel, and where the triangle found there does not hold what is seen.
    """
    tree = tree_of(scene.triangles)
    eye, rows, columns = view.camera_to_world[:3, 3], *np.nonzero(seen)
    on_grid = (rows % GRID == 0) & (columns % GRID == 0)
    triangles, weights = np.full(seen.shape, -1, np.int32), np.zeros((*seen.shape, 2), np.float32)
    groups = [(y[first:first + CHUNK], x[first:first + CHUNK])
              for y, x in ((rows[on_grid], columns[on_grid]), (rows[~on_grid], columns[~on_grid]))
              for first in range(0, len(y), CHUNK)]
    for i, (y, x) in enumerate(groups):
        report(i / len(groups), "Finding the triangles that are seen")
        point = position[y, x]
        guess = triangles[y - y % GRID, x - x % GRID]
        guess, inside = _holding(scene, guess, point, eye)
        new = np.flatnonzero(guess < 0)
        rays = view_rays_at(view, x[new] + 0.5, y[new] + 0.5)[1]
        guess[new], hit = _seen_along(tree, scene, eye, rays, point[new], shines[y[new], x[new]])
        inside[new] = _weights(scene.triangles[guess[new]], hit)
        triangles[y, x], weights[y, x] = guess, inside
    return triangles[seen], weights[seen]


def _holding(scene: RenderScene, triangle: np.ndarray, point: np.ndarray,
             eye: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`triangle` (S,) i32 where it holds `point` (S, 3), else -1; weights of corners 0 and 1 (S, 2) f32 there."""
    corners = scene.triangles[triangle]
    weights = _weights(corners, point)
    third = 1 - weights.sum(1)
    nearest = np.einsum("sk,skc->sc", np.column_stack([weights, third]), corners)
    off = np.linalg.norm(nearest - point, axis=1) / np.linalg.norm(point - eye, axis=1)
    return np.where((triangle >= 0) & (third >= 0) & (off < UNSEEN_LIGHT_TOLERANCE), triangle, -1), weights


def _seen_along(tree: BVHTree, scene: RenderScene, eye: np.ndarray, rays: np.ndarray, target: np.ndarray,
                shines: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangle (S,) i32 behind unit rays (S, 3) on which Cycles saw `target` (S, 3), and the point (S, 3) f32 on it."""
    triangle, distance = cast(tree, eye, rays)
    point = (eye + distance[:, None] * rays).astype(np.float32)
    unseen_light = scene.is_light[triangle] & ~shines
    tolerance = np.where(unseen_light, UNSEEN_LIGHT_TOLERANCE, TOLERANCE) * np.linalg.norm(target - eye, axis=1)
    other = np.flatnonzero((triangle < 0) | (np.linalg.norm(point - target, axis=1) > tolerance))
    for i, place in zip(other.tolist(), target[other].tolist()):
        point[i], _, triangle[i], _ = tree.find_nearest(place)
    return triangle, point


def _weights(triangles: np.ndarray, point: np.ndarray) -> np.ndarray:
    """(S, 2) f32 weights of corners 0 and 1 at points (S, 3) on triangles (S, 3, 3)."""
    return barycentric(triangles, point)[:, :2].clip(0, 1).astype(np.float32)


def _nearest(known: np.ndarray, needed: np.ndarray) -> np.ndarray:
    """(H, W) flat index of the pixel itself, or of a nearby `known` one for pixels that are `needed` but not known."""
    height, width = known.shape
    source = np.arange(height * width).reshape(height, width)
    known = known.copy()
    for _ in range(FILL_RADIUS):
        rows, columns = np.nonzero(needed & ~known)
        if not len(rows):
            break
        for dy, dx in ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
            y, x = (rows + dy).clip(0, height - 1), (columns + dx).clip(0, width - 1)
            found = known[y, x]
            source[rows[found], columns[found]] = source[y[found], x[found]]
        known[rows, columns] = source[rows, columns] != rows * width + columns
    return source
