# SPDX-License-Identifier: GPL-3.0-or-later
"""Denoise first hits behind smoke and fog.

A camera ray either scatters in a medium or reaches the surface behind it, by chance. So with a few samples, coverage
and colours are noisy there. They are averaged over neighbouring pixels, because a medium varies slowly; the colours of
the tokens behind it keep edges sharp.
"""
from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..camera import view_rays
from ..geometry import rotation_matrix
from ..pictures import box_sums
from ..scene import CELLS, Guides, View, Volumes

RADIUS = 4           # pixels, of the square that is averaged
CLEAR = 0.1          # transmittance below which the background behind a medium is averaged too
SAME = 0.01          # difference up to which colours of two pixels are the same
FAINT = 1e-4         # colour below which coverage cannot be derived from it
COLORS = ("diffuse_color", "glossy_color", "transmission_color")
PASSES = (*COLORS, "environment")  # of the guides, those that `smoothed` changes besides alpha


class Behind(NamedTuple):
    """The surfaces that pixels would show without a medium."""

    colors: np.ndarray  # (3, H, W, 3) f32 of the lobes, premultiplied
    share: np.ndarray   # (H, W) f32, of the pixel


def varies(picture: np.ndarray) -> np.ndarray:
    """(H, W) bool: pixels of (H, W, C) beside others that are not the same."""
    differs = np.zeros(picture.shape[:2], bool)
    for here, there in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
        other = (np.abs(picture[here] - picture[there]) > SAME).any(-1)
        differs[here] |= other
        differs[there] |= other
    return differs


def smoothed(guides: Guides, volumes: Volumes | None, view: View, surface: Behind | None = None) -> Guides:
    """Guides whose coverage and colours, and the environment by it, are local means where a ray crosses a medium.

    All are in one frame, in any units. If the `surface` behind the medium is known, the share of it that is visible in
    each colour is averaged, not the surface's colour.
    """
    inside = crossed(guides, volumes, view) if volumes else None
    if inside is None or not inside.any():
        return guides
    front = None if surface is None else surface.share
    changed = {"alpha": _mean_by_coverage(guides.alpha, inside, front)}
    for i, name in enumerate(COLORS):
        colors = getattr(guides, name)
        if surface is None:
            changed[name] = _mean(colors, inside, inside)
        else:
            visible, full = (_mean(c, inside, inside) for c in (colors, surface.colors[i]))
            of_all = _share(visible.mean(-1, keepdims=True), full.mean(-1, keepdims=True), 0)
            share = _share(visible, full, of_all)
            changed[name] = np.where(inside[..., None], surface.colors[i] * share, colors).astype(np.float32)
    through, clear = 1 - guides.alpha[..., None], 1 - changed["alpha"][..., None]
    behind = np.where(through > CLEAR, guides.environment / np.maximum(through, CLEAR),
                      _mean_by_coverage(guides.environment, inside, front) / np.maximum(clear, 1e-3))
    environment = np.where(inside[..., None], behind * clear, guides.environment)
    if guides.normal_variance is not None:  # samples that end in a medium have no normal
        variance = np.where(inside, 0, guides.normal_variance)
        changed["normal_variance"] = variance if variance.any() else None
    if guides.matte_share is not None:
        share = np.where(inside, 1, guides.matte_share)
        changed["matte_share"] = share if (share < 1).any() else None
    return replace(guides, environment=environment.astype(np.float32), **changed)


def _share(visible: np.ndarray, full: np.ndarray, otherwise: np.ndarray | float) -> np.ndarray:
    """(H, W, C) of the light of each colour that comes through a medium, by the colours that are seen and those of the
    surface behind it; `otherwise` where that is black."""
    return np.where(full > FAINT, visible / np.maximum(full, FAINT), otherwise)


def _mean_by_coverage(values: np.ndarray, inside: np.ndarray, share: np.ndarray | None) -> np.ndarray:
    """`_mean` over pixels with a surface and over the others, mixed by the surface's share of a pixel."""
    if share is None:
        return _mean(values, inside, inside)
    front, nothing = (_mean(values, inside & kind, inside) for kind in (share >= 0.5, share < 0.5))
    share = share[..., None] if values.ndim == 3 else share
    return share * front + (1 - share) * nothing


def _mean(values: np.ndarray, among: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(H, W, ...) f32 local means over pixels `among` (H, W) of others at some (H, W); the rest stays."""
    layers, among = values.reshape(*at.shape, -1), among[..., None]
    count = box_sums(among.astype(np.float32), RADIUS)
    mean = box_sums(layers * among, RADIUS) / np.maximum(count, 1)
    return np.where(at[..., None] & (count > 0.5), mean, layers).reshape(values.shape).astype(np.float32)


def crossed(guides: Guides, volumes: Volumes, view: View) -> np.ndarray:
    """(H, W) bool: the ray through the pixel's centre meets the box around a medium's cells before what it hits."""
    origin, rays = view_rays(view)
    hit = guides.hit_triangle >= 0
    farthest = np.where(hit, np.linalg.norm(guides.position - origin, axis=-1), np.inf)
    result = np.zeros(hit.shape, bool)
    boxes = np.concatenate([volumes.rotation, volumes.scale, volumes.scattering, volumes.absorption], axis=1)
    for box in np.unique(boxes, axis=0):
        cells = (boxes == box).all(axis=1)
        turn = rotation_matrix(box[:3]).astype(np.float32)
        places, half = volumes.position[cells] @ turn, box[3:6] / CELLS / 2
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse, eye = 1 / (rays @ turn), origin @ turn
            a, b = ((corner - eye) * inverse for corner in (places.min(axis=0) - half, places.max(axis=0) + half))
        enter, leave = np.nanmax(np.minimum(a, b), axis=-1), np.nanmin(np.maximum(a, b), axis=-1)
        result |= (enter < leave) & (leave > 0) & (enter < farthest)
    return result
