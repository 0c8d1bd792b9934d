# SPDX-License-Identifier: GPL-3.0-or-later
"""First hits from Cycles' passes: guides for any material, with the token triangle behind each pixel."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..camera import view_rays, view_rays_at
from ..geometry import barycentric, corner_weights
from ..progress import part
from ..rays import Rays
from ..scene import Guides, RenderScene, View
from ..shading import shading_normals
from . import denoise_media
from .camera_rays import FINDING, CameraRays
from .denoise_media import Behind
from .from_rays import lobe_colors

Passes = dict[str, np.ndarray]  # of one view: {key: (H, W, C) f32}, row 0 on top
NearestTriangles = Callable[[np.ndarray, np.ndarray], np.ndarray]  # (N, 3, 3) triangles, (k, 3) points -> (k,) indices

# A pixel's ray belongs to the triangle that it hits if that hit lies within this fraction of the distance of what
# Cycles saw. Decimated meshes and displacement pass; what Cycles' camera does not see (alpha cut-outs, hidden objects)
# fails, and the triangle nearest to what it saw is taken instead.
TOLERANCE = 0.01
# Camera rays pass through lamps, which may hang just below a ceiling: a light that shows no emission must fit closely.
UNSEEN_LIGHT_TOLERANCE = 1e-4
NOTHING_HIT = 1e9    # Cycles' Depth is 1e10 where the pixel's centre hits nothing
NOWHERE = 1e10       # that Depth
VISIBLE = ("normal", "emission", "environment")  # one of them is not 0 where anything is visible but a black world
COVERED = 1e-3       # alpha below this is not worth a token's attention
ONE_SURFACE = 0.95   # length of the mean of a pixel's unit normals above which it shows one surface
FILL_RADIUS = 4      # pixels
BATCH = 1 << 16      # pixels that are sampled by several rays at a time


def guides_from_passes(passes: Passes, scene: RenderScene, view: View, nearest_triangles: NearestTriangles) -> Guides:
    """First-hit guides of one view of `scene`, both in the world frame.

    passes: those of cycles/session.py `render_passes`. nearest_triangles: finds the triangles that are nearest to
    points.

    Cycles gives Position for the pixel's centre only. Pixels that are partly covered although their centre hits nothing
    (silhouettes, wires) take position and triangle from the nearest covered pixel. Normals become unit vectors; a pixel
    that shows several surfaces takes that of the one in its middle, for the mean belongs to none.

    Raises ValueError if the passes do not have the size of `view`.
    """
    alpha = passes["alpha"][..., 0].clip(0.0, 1.0)
    if alpha.shape != (view.height, view.width):
        raise ValueError(f"the passes are {alpha.shape[1]}x{alpha.shape[0]}, the view is {view.width}x{view.height}")
    covered = alpha > COVERED
    hit = covered & (passes["depth"][..., 0] < NOTHING_HIT)

    position = passes["position"] * hit[..., None]
    triangle = np.full(hit.shape, -1, np.int32)
    weights = np.zeros((*hit.shape, 2), np.float32)
    if len(scene) and hit.any():
        emits = (passes["emission"] > 0).any(axis=-1)
        triangle[hit], weights[hit] = _first_triangles(scene, view, position, hit, emits, nearest_triangles)
    has_media = scene.volumes is not None and len(scene.volumes) > 0 and len(scene) > 0
    if has_media:
        camera = CameraRays(scene, view)
        _add_hits_behind_media(camera, view, covered & ~hit, hit, position, triangle, weights)
    source = _nearest_pixels(hit, covered)
    guides = replace(guides_without_triangles(passes), position=position.reshape(-1, 3)[source],
                     hit_triangle=triangle.ravel()[source], hit_barycentric=weights.reshape(-1, 2)[source])
    several = (np.linalg.norm(passes["normal"], axis=-1) < ONE_SURFACE * alpha) & (guides.hit_triangle >= 0)
    middle, rays = corner_weights(guides.hit_barycentric[several]), view_rays(view)[1][several]
    guides.normal[several] = shading_normals(scene, guides.hit_triangle[several], middle, rays)
    behind = _behind_media(scene, camera, hit, triangle, weights) if has_media else None
    return denoise_media.smoothed(guides, scene.volumes, view, behind)


def guides_without_triangles(passes: Passes) -> Guides:
    """All guides but position and triangle, for `passes` that show the scene from several positions on the lens."""
    alpha, length = passes["alpha"][..., 0].clip(0, 1), np.linalg.norm(passes["normal"], axis=-1, keepdims=True)
    covered = (alpha > COVERED) | passes["transmission_color"].any(axis=-1)  # a denoiser spreads a little
    return Guides(
        position=np.zeros_like(passes["position"]), normal=passes["normal"] / np.where(length > 0, length, 1),
        diffuse_color=passes["diffuse_color"], glossy_color=passes["glossy_color"],
        transmission_color=passes["transmission_color"], emission=passes["emission"],
        environment=passes["environment"], depth=passes["depth"][..., 0], alpha=alpha,
        hit_triangle=np.full(alpha.shape, -1, np.int32), hit_barycentric=np.zeros((*alpha.shape, 2), np.float32),
        traced=passes["traced"] * covered[..., None] if "traced" in passes else None)


def clear_outside(passes: Passes, outside: np.ndarray | None) -> Passes:
    """The passes of a panorama with nothing in pixels (H, W) that look nowhere: Cycles gives them an alpha of 1.

    A pixel on the rim whose centre looks nowhere belongs to what its other samples show.
    """
    if outside is None or not outside.any():
        return passes
    empty = outside[..., None] & ~np.any([passes[key].any(-1, keepdims=True) for key in VISIBLE], axis=0)
    return passes | {"alpha": np.where(empty, np.float32(0), passes["alpha"]),
                     "depth": np.where(outside[..., None], np.float32(NOWHERE), passes["depth"])}


def _add_hits_behind_media(camera: CameraRays, view: View, hidden: np.ndarray, hit: np.ndarray, position: np.ndarray,
                           triangle: np.ndarray, weights: np.ndarray) -> None:
    """Write what the rays of `hidden` pixels (H, W) hit, which ended in a medium, into the other arrays."""
    rays = view_rays(view)[1][hidden]
    hits = camera.closest(rays)
    is_hit = hits.triangle >= 0
    pixels = tuple(index[is_hit] for index in np.nonzero(hidden))
    hit[pixels], triangle[pixels], weights[pixels] = True, hits.triangle[is_hit], hits.weights[is_hit]
    position[pixels] = hits.distance[is_hit, None] * rays[is_hit] + view.camera_to_world[:3, 3]


def _behind_media(scene: RenderScene, camera: CameraRays, hit: np.ndarray, triangle: np.ndarray,
                  weights: np.ndarray) -> Behind:
    """Lobe colours and coverage of the tokens `hit` (H, W), by more rays where neighbouring pixels differ."""
    colors, has_token = np.zeros((3, *hit.shape, 3), np.float32), hit & (triangle >= 0)
    if has_token.any():
        colors[:, has_token] = lobe_colors(scene, triangle[has_token], weights[has_token])
    coverage = has_token.astype(np.float32)
    varying = np.flatnonzero(denoise_media.varies(np.concatenate([*colors, coverage[..., None]], axis=-1)))
    for batch in np.array_split(varying, len(varying) // BATCH + 1):
        samples = camera.sample(batch)
        colors.reshape(3, -1, 3)[:, batch] = samples.colors.mean(2)
        coverage.reshape(-1)[batch] = samples.hit.mean(1)
    return Behind(colors, coverage)


def _first_triangles(scene: RenderScene, view: View, position: np.ndarray, hit: np.ndarray, emits: np.ndarray,
                     nearest_triangles: NearestTriangles) -> tuple[np.ndarray, np.ndarray]:
    """Token triangle (S,) i32 and weights of its corners 0 and 1 (S, 2) f32 for the S pixels of `hit`.

    The first one on the pixel's ray, visible or not; if what Cycles saw is not there, the first visible one; if it is
    not there either, the triangle nearest to it.
    """
    eye, (rows, columns), target = view.camera_to_world[:3, 3], np.nonzero(hit), position[hit]
    rays = view_rays_at(view, columns + 0.5, rows + 0.5)[1]
    triangle, weights = np.full(len(target), -1, np.int32), np.zeros((len(target), 2), np.float32)
    candidates, remaining = np.arange(len(scene)), np.arange(len(target))
    with part(0.0, 0.5, FINDING):
        for _ in range(2):
            hits = Rays(scene.triangles[candidates] - eye).closest(np.zeros(3), rays[remaining])
            point = hits.distance[:, None] * rays[remaining] + eye
            row = np.append(candidates, -1)[hits.triangle]
            unseen_light = scene.is_light[row] & ~emits[hit][remaining]
            tolerance = np.where(unseen_light, UNSEEN_LIGHT_TOLERANCE, TOLERANCE)
            away = np.linalg.norm(point - target[remaining], axis=1) / np.linalg.norm(target[remaining] - eye, axis=1)
            fits = (row >= 0) & (away <= tolerance)
            triangle[remaining[fits]], weights[remaining[fits]] = row[fits], hits.weights[fits]
            candidates, remaining = np.flatnonzero(scene.is_seen), remaining[~fits]
            if not len(remaining) or len(candidates) == len(scene):
                break
    if len(remaining):
        with part(0.5, 1.0, FINDING):
            nearest = nearest_triangles(scene.triangles, target[remaining])
        triangle[remaining] = nearest
        weights[remaining] = barycentric(scene.triangles[nearest], target[remaining])[:, :2].clip(0, 1)
    return triangle, weights


def _nearest_pixels(known: np.ndarray, needed: np.ndarray) -> np.ndarray:
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
            is_known = known[y, x]
            source[rows[is_known], columns[is_known]] = source[y[is_known], x[is_known]]
        known[rows, columns] = source[rows, columns] != rows * width + columns
    return source
