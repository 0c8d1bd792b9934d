# SPDX-License-Identifier: GPL-3.0-or-later
"""Pixels that see several surfaces: their added light is composited by coverage, not estimated at one mean normal.

A mean of the normals of a wall and a ceiling belongs to neither, and what is estimated there is a row of dots along the
edge. The surfaces on both sides are in the pixels beside it, and its colours hold how much of each it sees.
"""
from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from ..bands import bands
from ..box_filter import box_sums
from ..lobes import FAINT, Lobes
from ..scene import Guides

SHARP = 0.95   # length of the mean unit normal below which a pixel sees several surfaces


def blended(lobes: Lobes, guides: Guides, normal: np.ndarray) -> Lobes:
    """`lobes` with the light that was not traced taken, in pixels of several surfaces, from the pixels around.

    normal (H, W, 3) is the sum of the unit normals of a pixel's samples divided by their number, as Cycles gives it.
    """
    parts = [_blended(lobes.rows(outer), guides.rows(outer), normal[outer]).rows(inner)
             for outer, inner in bands(*guides.alpha.shape, margin=1)]
    joined = {f.name: np.concatenate([getattr(part, f.name) for part in parts], axis=-3)
              for f in fields(Lobes) if getattr(lobes, f.name) is not None}
    return Lobes(**joined)


def _blended(lobes: Lobes, guides: Guides, normal: np.ndarray) -> Lobes:
    color = guides.diffuse_color + guides.glossy_color + guides.transmission_color
    several = (np.linalg.norm(normal, axis=-1) < SHARP * guides.alpha)[..., None]
    traced = 0 if lobes.traced is None else lobes.traced
    added = lobes.radiance - traced
    clean = ~several & (color > FAINT)
    light = box_sums(np.where(clean, added / np.maximum(color, FAINT), 0), 1)
    count = box_sums(clean.astype(np.float32), 1)
    mended = np.where(several & (count > 0), color * light / np.maximum(count, 1), added)
    scale = mended / np.maximum(added, FAINT ** 2)
    known = {name: light for name in ("direct", "indirect") if (light := getattr(lobes, name)) is not None}
    return replace(lobes, radiance=traced + mended, **{name: light * scale for name, light in known.items()})
