# SPDX-License-Identifier: GPL-3.0-or-later
"""What a way from a scene to a picture has to offer the renderer: guided/pipeline.py and published/pipeline.py do.

Scenes, views and guides are normalised here (normalize.py): network units of length, network exposure. Tensors are on
the pipeline's device. Everything runs inside `inference()` (compute/inference.py).
"""
from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from torch import Tensor

from .light.effort import FULL, Effort
from .light_passes import Lobes
from .scene import Guides, RenderScene, View


class Encoded(Protocol):
    """A scene after stage 1, which any number of views share."""

    tokens: int     # length of its sequence
    is_draft: bool  # whether stage 1 is missing yet


class Pipeline(Protocol):
    """From a scene to pictures of it. Not thread-safe."""

    granularity: int  # pixels: the sides of a view are multiples of it

    def variant(self, picture_size: int) -> str:
        """Which of its networks renders pictures whose longer side has so many pixels; "" where there is one only."""

    def prepare(self, scene: RenderScene) -> None:
        """Compute and cache what later scenes may share with this one; nothing, unless a pipeline has such parts."""

    def encode(self, scene: RenderScene, variant: str) -> Encoded:
        """Everything that does not depend on the view. Raises CheckpointError for weights that cannot be used."""

    def image(self, encoded: Encoded, view: View, guides: Guides, effort: Effort = FULL) -> Tensor:
        """(3, H, W) f32 radiance of surfaces and volumes, without emitters and world that the camera sees directly."""


@runtime_checkable
class LobePipeline(Pipeline, Protocol):
    """A pipeline that knows the light of each lobe, shows drafts, and smooths finished pictures."""

    def draft(self, scene: RenderScene, variant: str) -> Encoded:
        """A quick substitute for `encode`: views of it show the estimated light, by fewer rays."""

    def finished(self, draft: Encoded) -> Encoded:
        """What `encode` would have returned for the scene of a draft."""

    def lobes(self, encoded: Encoded, view: View, guides: Guides, apart: bool = True,
              effort: Effort = FULL) -> dict[str, Tensor]:
        """Pictures by field of Lobes, in network exposure: "radiance" (3, H, W) as of `image`, "traced" (3, H, W) if
        light was traced, "latent" (C, H, W), and if `apart` "direct" and "indirect" (3 lobes, 3, H, W) before the
        lobes' albedos."""

    def antialiased(self, pictures: dict[str, np.ndarray], lobes: Lobes, guides: Guides,
                    wraps: bool = False) -> dict[str, np.ndarray]:
        """All `pictures` (H, W, C) f32 with smooth edges, in world radiance (guided/kernels.py)."""
