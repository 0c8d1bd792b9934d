# SPDX-License-Identifier: GPL-3.0-or-later
"""The light of some lights of a scene, for renders and viewports: without the transformer, which is not linear."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...model.light.specular.ends import add_path_ends
from ...model.scene import Guides, RenderScene, View


class LightSubset:
    """The light of some lights of a scene."""

    def __init__(self, renderer, scene: RenderScene, subset: RenderScene, picture_size: int) -> None:
        """renderer: a model.renderer.Renderer with lobes. subset: `scene` with these lights (model/light_groups.py).
        picture_size: as of Renderer.encode.
        """
        self.scene, self._subset = scene, subset
        self._encoded = renderer.encode(subset, picture_size, draft=True)

    def light(self, view: View, guides: Guides, follows_paths: bool, **effort) -> np.ndarray:
        """(H, W, 3) world radiance: all light, or bounced light alone where light was traced.

        follows_paths: whether mirrors and glass show the lights at the ends of specular paths. effort: as of
        EncodedScene.view.
        """
        if guides.traced is not None:
            guides = replace(guides, traced=np.zeros_like(guides.traced))
        elif follows_paths:
            guides = add_path_ends(guides, self._subset, view)
        return self._encoded.view(view, guides, **effort)
