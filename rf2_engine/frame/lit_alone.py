# SPDX-License-Identifier: GPL-3.0-or-later
"""A scene with some of its lights alone, for renders and viewports: without the transformer, which is not linear."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...model.light.specular.ends import add_path_ends
from ...model.scene import Guides, RenderScene, View


class LitAlone:
    """The light of a scene that is lit by some of its lights."""

    def __init__(self, renderer, scene: RenderScene, lit: RenderScene, picture_size: int) -> None:
        """renderer: a model.renderer.Renderer with lobes. lit: `scene` with these lights (model/light_groups.py).
        picture_size: as of Renderer.encode.
        """
        self.scene, self._lit = scene, lit
        self._encoded = renderer.encode(lit, picture_size, draft=True)

    def light(self, view: View, guides: Guides, follows_paths: bool, **effort) -> np.ndarray:
        """(H, W, 3) world radiance: all light, or bounced light alone where light was traced.

        follows_paths: whether mirrors and glass show the lights at the ends of specular paths. effort: as of
        EncodedScene.view.
        """
        if guides.traced is not None:
            guides = replace(guides, traced=np.zeros_like(guides.traced))
        elif follows_paths:
            guides = add_path_ends(guides, self._lit, view)
        return self._encoded.view(view, guides, **effort)
