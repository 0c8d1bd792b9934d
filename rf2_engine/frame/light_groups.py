# SPDX-License-Identifier: GPL-3.0-or-later
"""The passes of light groups: Cycles traces direct light of each, bounced light is estimated for each by itself. So is
the light that negative lamps take away.
"""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...model import light_groups, progress
from ...model.light.specular.ends import add_path_ends
from ...model.light_passes import Lobes
from ...model.scene import Guides, RenderScene, View
from .. import passes as pass_table
from ..cycles.run import Passes
from .first_hits import FirstHits


class GroupEstimates:
    """A scene with the lights of each group alone, and of no group, without the transformer: it is not linear."""

    def __init__(self, renderer, scene: RenderScene, groups: int, view: View) -> None:
        """renderer: a model.renderer.Renderer. groups: their number. view: one of those that will be lit."""
        self.scene, self._lit = scene, {}
        self._count = groups + 1
        for group in filter(lambda group: light_groups.has_lights(scene, group), range(self._count)):
            with progress.part(0.5 * group / self._count, 0.5 * (group + 1) / self._count):
                lit = light_groups.lit_by(scene, group)
                self._lit[group] = lit, renderer.encode(lit, view.longer_side, draft=True)

    def light(self, view: View, guides: Guides, follows_paths: bool) -> np.ndarray:
        """(groups + 1, H, W, 3) as Lobes.groups: bounced light where light was traced, else all light.

        follows_paths: whether mirrors and glass show the lights of the group at the ends of specular paths.
        """
        pictures = np.zeros((self._count, *guides.alpha.shape, 3), np.float32)
        for group, (lit, encoded) in self._lit.items():
            with progress.part(0.5 + 0.5 * group / self._count, 0.5 + 0.5 * (group + 1) / self._count):
                pictures[group] = _estimate(encoded, lit, view, guides, follows_paths)
        return pictures


class NegativeLight:
    """A scene with its negative lamps alone, without the transformer."""

    def __init__(self, renderer, scene: RenderScene, view: View) -> None:
        """Arguments as of GroupEstimates."""
        self.scene, self._lit = scene, light_groups.lit_by_negative(scene)
        self._encoded = renderer.encode(self._lit, view.longer_side, draft=True)

    def taken_from(self, lobes: Lobes, view: View, guides: Guides, follows_paths: bool) -> Lobes:
        """What is left of the light of a view; traced light lacks the direct light that they take already."""
        taken = _estimate(self._encoded, self._lit, view, guides, follows_paths)
        return replace(lobes.scaled_to((lobes.radiance - taken).clip(0)), latent=lobes.latent)


def _estimate(encoded, lit: RenderScene, view: View, guides: Guides, follows_paths: bool) -> np.ndarray:
    """(H, W, 3) light of the encoded scene `lit`: where light was traced, bounced light alone."""
    if guides.traced is not None:
        guides = replace(guides, traced=np.zeros_like(guides.traced))
    elif follows_paths:
        guides = add_path_ends(guides, lit, view)
    return encoded.lobes(view, guides, apart=False).radiance


def group_passes(groups: list[pass_table.Pass], combined: np.ndarray, shown: Guides, lobes: Lobes, hits: FirstHits,
                 scene: RenderScene) -> Passes:
    """The passes of a finished picture: combined (H, W, 4), its guides and its light."""
    if not groups:
        return {}
    sampled = np.stack([hits.passes[p.key] for p in groups])
    light = light_groups.divide(combined[..., :3], shown, lobes, sampled, hits.guides, scene,
                                with_environment=hits.opacity is not None)
    return {p.key: own for p, own in zip(groups, light, strict=True)}
