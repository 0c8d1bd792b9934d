# SPDX-License-Identifier: GPL-3.0-or-later
"""The network's `Guides`: from Cycles' first-hit passes, or from the token triangles alone."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...model.camera import view_rays, view_rays_at
from ...model.first_hits import denoise_media
from ...model.first_hits.camera_rays import CameraRays
from ...model.first_hits.denoise_media import Behind
from ...model.first_hits.from_rays import guides_of_hits, lobe_colors, mean_guides
from ...model.geometry import barycentric, corner_weights
from ...model.progress import part
from ...model.rays import Rays
from ...model.scene import Guides, RenderScene, View
from ...model.shading import shading_normals
from ..convert.meshes.nearest import Surface

# A pixel's ray belongs to the triangle that it hits if that hit lies within this fraction of the distance of what
# Cycles saw. Decimated meshes and displacement pass; what Cycles' camera does not see (alpha cut-outs, hidden objects)
# fails, and the triangle nearest to what it saw is taken instead.
TOLERANCE = 0.01
# Camera rays pass through lamps, which may hang just below a ceiling: a light that shows no emission must fit closely.
UNSEEN_LIGHT_TOLERANCE = 1e-4
NOTHING_HIT = 1e9    # Cycles' Depth is 1e10 where the pixel's centre hits nothing
NOWHERE = 1e10       # that Depth
LOOKED = ("normal", "emission", "environment")  # of which one is not 0 where anything was seen, but for a black world
COVERED = 1e-3       # alpha below this is not worth a token's attention
ONE_SURFACE = 0.95   # length of the mean of a pixel's unit normals from which it sees one surface
FILL_RADIUS = 4      # pixels
AT_ONCE = 1 << 16    # pixels, of which several samples are taken
FINDING = "Finding visible triangles"
CENTRE = ((0.5, 0.5),)
SPREAD = ((0.375, 0.125), (0.875, 0.375), (0.625, 0.875), (0.125, 0.625))  # over a pixel, no two in a row or column


def cast_guides(scene: RenderScene, view: View, places: Sequence[tuple[float, float]] = CENTRE) -> Guides:
    """First-hit guides of one view of `scene` (world frame) by rays through these places of each pixel.

    For whoever has no passes of Cycles, such as a viewport: nothing that is not in a token.
    """
    camera, found = CameraRays(scene, view), []
    for i, place in enumerate(places):
        rays = view_rays(replace(view, principal=view.principal - np.subtract(place, 0.5)))[1]
        with part(i / len(places), (i + 1) / len(places), FINDING):
            met = camera.closest(rays.reshape(-1, 3))
        found.append(guides_of_hits(scene, view, rays, met.triangle.reshape(view.height, view.width),
                                    met.weights.reshape(view.height, view.width, 2)))
    return mean_guides(found)


def make_guides(passes: dict[str, np.ndarray], scene: RenderScene, view: View) -> Guides:
    """First-hit guides of one view from `passes` (cycles_session.render_passes) and `scene` (world frame).

    Cycles gives Position for the pixel's centre only. Pixels that are partly covered although their centre hits nothing
    (silhouettes, wires) take position and triangle from the nearest covered pixel. Normals become unit vectors; a pixel
    that sees several surfaces takes that of the one in its middle, for the mean belongs to none.

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
    media = scene.volumes is not None and len(scene.volumes) > 0 and len(scene) > 0
    if media:
        camera = CameraRays(scene, view)
        _behind_media(camera, view, covered & ~seen, seen, position, triangle, weights)
    source = _nearest(seen, covered)
    guides = replace(guides_of_no_triangle(passes), position=position.reshape(-1, 3)[source],
                     hit_triangle=triangle.ravel()[source], hit_barycentric=weights.reshape(-1, 2)[source])
    several = (np.linalg.norm(passes["normal"], axis=-1) < ONE_SURFACE * alpha) & (guides.hit_triangle >= 0)
    middle, rays = corner_weights(guides.hit_barycentric[several]), view_rays(view)[1][several]
    guides.normal[several] = shading_normals(scene, guides.hit_triangle[several], middle, rays)
    behind = _behind(scene, camera, seen, triangle, weights) if media else None
    return denoise_media.smoothed(guides, scene.volumes, view, behind)


def _behind_media(camera: CameraRays, view: View, hidden: np.ndarray, seen: np.ndarray, position: np.ndarray,
                  triangle: np.ndarray, weights: np.ndarray) -> None:
    """Write what the rays of `hidden` pixels (H, W) meet, which ended in a medium, into the other arrays."""
    rays = view_rays(view)[1][hidden]
    met = camera.closest(rays)
    hit = met.triangle >= 0
    place = tuple(index[hit] for index in np.nonzero(hidden))
    seen[place], triangle[place], weights[place] = True, met.triangle[hit], met.weights[hit]
    position[place] = met.distance[hit, None] * rays[hit] + view.camera_to_world[:3, 3]


def _behind(scene: RenderScene, camera: CameraRays, seen: np.ndarray, triangle: np.ndarray,
            weights: np.ndarray) -> Behind:
    """What is `seen` (H, W) of the tokens, by more rays where it is not the same all around."""
    colors, known = np.zeros((3, *seen.shape, 3), np.float32), seen & (triangle >= 0)
    if known.any():
        colors[:, known] = lobe_colors(scene, triangle[known], weights[known])
    share = known.astype(np.float32)
    at = np.flatnonzero(denoise_media.varies(np.concatenate([*colors, share[..., None]], axis=-1)))
    for some in np.array_split(at, len(at) // AT_ONCE + 1):
        samples = camera.sample(some)
        colors.reshape(3, -1, 3)[:, some], share.reshape(-1)[some] = samples.colors.mean(2), samples.hit.mean(1)
    return Behind(colors, share)


def inside(passes: dict[str, np.ndarray], outside: np.ndarray | None) -> dict[str, np.ndarray]:
    """The passes of a panorama with nothing where pixels (H, W) look nowhere: Cycles gives them an alpha of 1.

    A pixel on the rim whose centre looks nowhere belongs to what its other samples see.
    """
    if outside is None or not outside.any():
        return passes
    nothing = outside[..., None] & ~np.any([passes[key].any(-1, keepdims=True) for key in LOOKED], axis=0)
    return passes | {"alpha": np.where(nothing, np.float32(0), passes["alpha"]),
                     "depth": np.where(outside[..., None], np.float32(NOWHERE), passes["depth"])}


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

    The first on the pixel's ray, be it seen or not; if what Cycles saw is not there, the first that is seen; if it is
    not there either, the triangle nearest to it.
    """
    eye, (rows, columns), target = view.camera_to_world[:3, 3], np.nonzero(seen), position[seen]
    rays = view_rays_at(view, columns + 0.5, rows + 0.5)[1]
    triangle, weights = np.full(len(target), -1, np.int32), np.zeros((len(target), 2), np.float32)
    among, left = np.arange(len(scene)), np.arange(len(target))
    with part(0.0, 0.5, FINDING):
        for _ in range(2):
            met = Rays(scene.triangles[among] - eye).closest(np.zeros(3), rays[left])
            at = met.distance[:, None] * rays[left] + eye
            found = np.append(among, -1)[met.triangle]
            unseen_light = scene.is_light[found] & ~shines[seen][left]
            tolerance = np.where(unseen_light, UNSEEN_LIGHT_TOLERANCE, TOLERANCE)
            off = np.linalg.norm(at - target[left], axis=1) / np.linalg.norm(target[left] - eye, axis=1)
            held = (found >= 0) & (off <= tolerance)
            triangle[left[held]], weights[left[held]] = found[held], met.weights[held]
            among, left = np.flatnonzero(scene.is_seen), left[~held]
            if not len(left) or len(among) == len(scene):
                break
    if len(left):
        with part(0.5, 1.0, FINDING):
            corners = scene.triangles.astype(np.float64)
            nearest = Surface(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)).nearest(target[left])
        triangle[left], weights[left] = nearest, _weights(scene.triangles[nearest], target[left])
    return triangle, weights


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
