# SPDX-License-Identifier: GPL-3.0-or-later
"""The passes of light groups: Cycles traces direct light of each, bounced light is estimated for each by itself."""
from __future__ import annotations

import numpy as np

from ...model import light_groups, progress
from ...model.light_passes import Lobes
from ...model.scene import Guides, RenderScene, View
from .. import passes as pass_table
from ..cycles.run import Passes
from .first_hits import FirstHits
from .light_subset import LightSubset


class GroupEstimates:
    """A scene with the lights of each group alone, and of no group, without the transformer: it is not linear."""

    def __init__(self, renderer, scene: RenderScene, groups: int, view: View) -> None:
        """renderer: a model.renderer.Renderer. groups: their number. view: one of those that will be lit."""
        self.scene, self._subsets = scene, {}
        self._count = groups + 1
        for group in filter(lambda group: light_groups.has_lights(scene, group), range(self._count)):
            with progress.part(0.5 * group / self._count, 0.5 * (group + 1) / self._count):
                self._subsets[group] = LightSubset(renderer, scene, light_groups.lit_by(scene, group), view.longer_side)

    def light(self, view: View, guides: Guides, follows_paths: bool) -> np.ndarray:
        """(groups + 1, H, W, 3) as Lobes.groups: bounced light where light was traced, else all light.

        follows_paths: whether mirrors and glass show the lights of the group at the ends of specular paths.
        """
        pictures = np.zeros((self._count, *guides.alpha.shape, 3), np.float32)
        for group, subset in self._subsets.items():
            with progress.part(0.5 + 0.5 * group / self._count, 0.5 + 0.5 * (group + 1) / self._count):
                pictures[group] = subset.light(view, guides, follows_paths)
        return pictures


def group_passes(groups: list[pass_table.Pass], combined: np.ndarray, guides: Guides, lobes: Lobes, hits: FirstHits,
                 scene: RenderScene) -> Passes:
    """The passes of a finished picture: combined (H, W, 4), its guides and its light."""
    if not groups:
        return {}
    sampled = np.stack([hits.passes[p.key] for p in groups])
    light = light_groups.divide(combined[..., :3], guides, lobes, sampled, hits.guides, scene,
                                with_environment=hits.opacity is not None)
    return {p.key: own for p, own in zip(groups, light, strict=True)}
