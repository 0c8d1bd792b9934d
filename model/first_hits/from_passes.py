# SPDX-License-Identifier: GPL-3.0-or-later
"""First hits from Cycles' passes: guides for any material, with the token triangle behind each pixel."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..camera import view_rays
from ..geometry import dot, unit
from ..pictures import box_means
from ..progress import report
from ..rays import Hits
from ..scene import Guides, RenderScene, View
from . import bumps, denoise_media, emitter_silhouettes, glass_from_inside, rough_gloss
from .camera_rays import CameraRays
from .denoise_media import Behind
from .first_surfaces import FirstSurfaces, NearestTriangles, find_first_surfaces, nearest_pixels
from .from_rays import lobe_colors

Passes = dict[str, np.ndarray]  # of one view: {key: (H, W, C) f32}, row 0 on top

NOTHING_HIT = 1e9    # Cycles' Depth is 1e10 where the pixel's centre hits nothing
NOWHERE = 1e10       # that Depth
VISIBLE = ("normal", "emission", "environment")  # one of them is not 0 where anything is visible but a black world
COVERED = 1e-3       # alpha below this is not worth a token's attention
ONE_SURFACE = 0.95   # length of the mean of a pixel's unit normals above which it shows one surface
APART = 0.1          # difference of two unit normals of which a pixel must not show the mean
BETWEEN = 0.03       # distance from the line between the two at which a normal belongs to neither, such as a bump's
UNBENT = 0.2         # cosine to the viewer from which on Cycles does not bend normals
NEAR_FIBRES = 2      # pixels


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

    surfaces = FirstSurfaces.empty(passes["position"] * hit[..., None])
    if len(scene) and hit.any():
        emits = (passes["emission"] > 0).any(axis=-1)
        surfaces.set(hit, find_first_surfaces(scene, view, surfaces.position[hit], hit, emits[hit], nearest_triangles))
    has_media = bool(scene.volumes) and len(scene) > 0
    if has_media:
        camera = CameraRays(scene, view)
        _add_hits_behind_media(camera, scene, view, covered & ~hit, hit, surfaces)
        covered &= hit | _show_surfaces(passes)
    report()
    shown = surfaces.taken(nearest_pixels(hit, covered))
    guides = replace(guides_without_triangles(passes), position=shown.position, hit_triangle=shown.token,
                     hit_barycentric=shown.weights)
    report()
    guides = _with_normals(guides, passes["normal"], shown, view)
    report()
    guides = glass_from_inside.with_reflectance(emitter_silhouettes.smoothed(guides, scene, view), scene, view)
    guides = rough_gloss.with_kept(guides, scene, view)
    if guides.traced is None:
        guides = _with_fibres(guides, scene, view)
    behind = _behind_media(scene, camera, hit, surfaces) if has_media else None
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
        traced=passes["traced"] * covered[..., None] if "traced" in passes else None,
        noise=passes.get("noise") if "traced" in passes else None,
        is_noisy=np.ones(alpha.shape, bool) if "traced" in passes and "noise" not in passes else None,
        samples=passes["samples"][..., 0] if "samples" in passes else None)


def clear_outside(passes: Passes, outside: np.ndarray | None) -> Passes:
    """The passes of a panorama with nothing in pixels (H, W) that look nowhere: Cycles gives them an alpha of 1.

    A pixel on the rim whose centre looks nowhere belongs to what its other samples show.
    """
    if outside is None or not outside.any():
        return passes
    empty = outside[..., None] & ~np.any([passes[key].any(-1, keepdims=True) for key in VISIBLE], axis=0)
    return passes | {"alpha": np.where(empty, np.float32(0), passes["alpha"]),
                     "depth": np.where(outside[..., None], np.float32(NOWHERE), passes["depth"])}


def _with_normals(guides: Guides, normal: np.ndarray, shown: FirstSurfaces, view: View) -> Guides:
    """Guides that know of bumps, with the normals of the surfaces `shown` (H, W) where pixels show several ones.

    normal: (H, W, 3), the pass: sums over a pixel's samples, the shorter the less covers it and the more they differ.
    """
    mean = normal / np.maximum(guides.alpha, COVERED)[..., None]
    variance = bumps.normal_variance(mean, guides.samples, shown.position, shown.normal)
    several = np.linalg.norm(normal, axis=-1) < ONE_SURFACE * guides.alpha
    several |= lies_between(guides.normal, shown.normal) & (-dot(shown.normal, view_rays(view)[1]) > UNBENT)
    several &= shown.token >= 0
    return replace(guides, normal_variance=variance,
                   matte_share=bumps.matte_share(mean, guides.samples, shown.normal),
                   normal=np.where(several[..., None], shown.normal, guides.normal))


def _with_fibres(guides: Guides, scene: RenderScene, view: View) -> Guides:
    """Hair as the diffuse surfaces that its tokens are: Cycles' passes show the colour of hair as a whole, as gloss."""
    if scene.fibre is None:
        return guides
    is_fibre = np.append(scene.fibre[scene.seen_tile] > 0.5, False)  # by token; the last one, -1, is no surface
    near = box_means(is_fibre[guides.hit_triangle, None].astype(np.float32), NEAR_FIBRES)
    pixels, camera = np.flatnonzero(near > 0), CameraRays(scene, view)
    guides = replace(guides, diffuse_color=guides.diffuse_color.copy(), glossy_color=guides.glossy_color.copy())
    for rows, samples in camera.sample_batches(pixels):
        shows = is_fibre[samples.token][..., None]
        guides.diffuse_color.reshape(-1, 3)[pixels[rows]] += (samples.colors[0] * shows).mean(1)
        guides.glossy_color.reshape(-1, 3)[pixels[rows]] = (samples.colors[1] * ~shows).mean(1)
    return guides


def _add_hits_behind_media(camera: CameraRays, scene: RenderScene, view: View, hidden: np.ndarray, hit: np.ndarray,
                           surfaces: FirstSurfaces) -> None:
    """Write what the rays of `hidden` pixels (H, W) hit, which ended in a medium, into `hit` and the surfaces."""
    rays = view_rays(view)[1][hidden]
    hits = camera.closest(rays)
    is_hit = hits.triangle >= 0
    pixels = tuple(index[is_hit] for index in np.nonzero(hidden))
    hit[pixels] = True
    some = Hits(*(x[is_hit] for x in hits))
    surfaces.set(pixels, FirstSurfaces.of_hits(scene, some, view.camera_to_world[:3, 3], rays[is_hit]))


def _show_surfaces(passes: Passes) -> np.ndarray:
    """(H, W) bool: pixels that show some of a surface, and not only a medium, which covers them too."""
    return np.any([passes[key].any(-1) for key in ("normal", *denoise_media.COLORS)], 0)


def _behind_media(scene: RenderScene, camera: CameraRays, hit: np.ndarray, surfaces: FirstSurfaces) -> Behind:
    """Lobe colours and coverage of the tokens `hit` (H, W), by more rays where neighbouring pixels differ.

    What a holdout shows through a medium is the medium alone, as where there is no surface.
    """
    covers = np.append(~scene.seldom("is_holdout"), False)  # by token; the last one, -1, is no surface
    colors, is_covered = np.zeros((3, *hit.shape, 3), np.float32), hit & covers[surfaces.token]
    if is_covered.any():
        colors[:, is_covered] = lobe_colors(scene, surfaces.token[is_covered], surfaces.weights[is_covered])
    coverage = is_covered.astype(np.float32)
    varying = np.flatnonzero(denoise_media.varies(np.concatenate([*colors, coverage[..., None]], axis=-1)))
    for rows, samples in camera.sample_batches(varying):
        is_covered = covers[samples.token]
        colors.reshape(3, -1, 3)[:, varying[rows]] = (samples.colors * is_covered[..., None]).mean(2)
        coverage.reshape(-1)[varying[rows]] = is_covered.mean(1)
    return Behind(colors, coverage)


def lies_between(mean: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """(H, W) bool: pixels of which the mean normal (H, W, 3) is one of different surfaces, as of two facets.

    It lies between the unit normals (H, W, 3) that the geometry has in the middle of the pixel and of a neighbour.
    """
    height, width = middle.shape[:2]
    result, padded = np.zeros((height, width), bool), np.pad(middle, ((1, 1), (1, 1), (0, 0)), mode="edge")
    for y, x in ((0, 1), (1, 0), (1, 2), (2, 1)):
        step = padded[y:y + height, x:x + width] - middle
        length2 = dot(step, step)
        pixel = np.nonzero((length2 > APART ** 2) & (length2 < 2))  # beyond, the mean is short anyway
        here, step, length2 = middle[pixel], step[pixel], length2[pixel]
        along = (dot(mean[pixel] - here, step) / length2).clip(0, 1)
        away = mean[pixel] - unit(here + along[:, None] * step)
        result[pixel] |= dot(away, away) < (BETWEEN + BETWEEN * np.sqrt(length2)) ** 2
    return result
