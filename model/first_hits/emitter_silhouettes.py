# SPDX-License-Identifier: GPL-3.0-or-later
"""Smooth silhouettes of directly seen emitters, however few samples Cycles had.

Where a hundredth of a pixel shows a lamp that is a hundred times as bright as white, the pixel is white; of a few
samples one meets the lamp by chance. Rays find how much of such pixels each emitter covers.
"""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..pictures import box_means, box_sums
from ..scene import Guides, RenderScene, View
from .camera_rays import CameraRays

REACH = 2               # pixels between a silhouette and the farthest that its filter reaches, about
MOST, FEWEST = 256, 64  # rays through a pixel; with fewer Cycles' samples are as good
RAYS = 1 << 21          # through all pixels at most; where there are more such pixels, they stay as they are
AROUND = 4              # pixels: the emission of so many on all sides says how bright the emitter is there
SURE = 16.0             # samples that have met it, for which that counts half
ALIKE = 4.0             # factor between it and what rays find, from which on these do not see what Cycles sees


def smoothed(guides: Guides, scene: RenderScene, view: View) -> Guides:
    """First hits of Cycles (world frame), whose pixels at silhouettes of emitters have the emission that rays find.

    How bright an emitter is there, such as a screen with a picture, is what Cycles' samples around say.
    """
    shines = (guides.emission > 0).any(axis=-1, keepdims=True)
    near = box_means(shines.astype(np.float32), REACH)[..., 0]
    samples = np.full_like(guides.alpha, 1) if guides.samples is None else guides.samples
    pixel = np.flatnonzero((near > 0) & (near < 1) & (samples < FEWEST))
    count = _power_of_two(RAYS // max(len(pixel), 1))
    if not len(pixel) or count < FEWEST:
        return guides
    found, share = np.zeros_like(guides.emission), np.zeros_like(shines, np.float32)
    found.reshape(-1, 3)[pixel], share.reshape(-1)[pixel] = CameraRays(scene, view).emission(pixel, min(count, MOST))
    met = samples[..., None] * share
    ours, theirs, met = (box_sums(x * (share > 0), AROUND) for x in (found, guides.emission, met))
    ratio = np.divide(theirs, ours, out=np.ones_like(ours), where=ours > 0)
    is_alike = (theirs.sum(-1) * ALIKE > ours.sum(-1)) & (ours.sum(-1) * ALIKE > theirs.sum(-1))
    is_partly = (share > 0) & (share < 1) & is_alike[..., None]
    found *= 1 + met / (met + SURE) * (ratio - 1)
    return replace(guides, emission=np.where(is_partly, found, guides.emission))


def _power_of_two(count: int) -> int:
    """The largest one up to count, 0 for 0."""
    return 1 << count.bit_length() - 1 if count else 0
