# SPDX-License-Identifier: GPL-3.0-or-later
"""From the copy of a scene to pictures of it, on any thread: first hits by rays of our own, light by the network."""
from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import bpy
import numpy as np

from ...model import progress
from ...model.light.effort import FULL, QUICK
from ...model.light.specular.ends import add_path_ends
from ...model.rays import Rays
from ...model.scene import RenderScene, View
from ..convert import compute
from ..convert.data.copied import Copied
from ..convert.data.memo import Memo
from ..convert.data.report import Report
from ..convert.fitting.framing import Framing
from ..convert.fitting.scene_box import fit_box
from ..frame import output
from ..frame.guides import CENTRE, SPREAD, cast_guides
from ..frame.shot import has_left
from ..runtime import model_cache
from ..settings import FrameSettings
from .source import State

COARSE = 4  # what pixels are divided by in pictures that are quickly made


@dataclass(frozen=True)
class Look:
    """The settings that decide what a viewport shows."""

    frame: FrameSettings  # of a render, with the viewport's own Max Triangles
    finest: int           # what the pixels along a side are divided by at most
    time_limit: float     # seconds of one picture, 0 = any

    @classmethod
    def of(cls, scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> Look:
        """Raises CheckpointError as FrameSettings.of does."""
        chosen = scene.renderformer_v2.viewport
        frame = replace(FrameSettings.of(scene, view_layer), token_budget=chosen.token_budget, guide_samples=1,
                        reference=None)
        return cls(frame, int(chosen.resolution), chosen.time_limit)

    @property
    def of_scene(self) -> tuple:
        """What of it decides how a scene is encoded."""
        frame = self.frame
        return (frame.weights, frame.transformer, frame.device, frame.precision, frame.token_budget, frame.max_edge,
                frame.guided)

    @property
    def of_picture(self) -> tuple:
        return *self.of_scene, self.frame.film_transparent, self.frame.exposure


@dataclass(eq=False, frozen=True)
class Lit:
    """A scene that is ready for views of it."""

    state: State            # of the source that was copied
    made_with: tuple        # Look.of_scene
    scene: RenderScene
    framing: Framing
    encoded: object | None  # model.renderer.EncodedScene; None: there is nothing to light
    content: bytes          # model_cache.fingerprint

    @property
    def is_draft(self) -> bool:
        return self.encoded is not None and self.encoded.is_draft

    @cached_property
    def rays(self) -> Rays:
        """Against all triangles, in the world."""
        return Rays(self.scene.triangles)

    @property
    def points(self) -> np.ndarray:
        """(k, 3) corners of what is seen."""
        return self.scene.triangles[self.scene.is_seen].reshape(-1, 3)


def light(copied: Copied, state: State, view: View, look: Look, before: Lit | None, report: Report,
          memo: Memo) -> Lit:
    """Convert and encode a copy of a scene, for this view and those like it, as a draft where the network has them.

    before: what was shown of the scene until now, whose box and shares of triangles are kept as long as they fit.
    memo: of conversions before.
    """
    settings, framing = look.frame, None

    def steady(own: Framing) -> Framing:
        nonlocal framing
        framing = before.framing if before and not has_left(before.framing.box, own.box) else own
        return framing

    with progress.part(0.0, 0.4, "Converting the scene"):
        scene = compute.compute(copied, view, token_budget=settings.token_budget, max_edge=settings.max_edge,
                                as_is=settings.as_is, paper_lamps=settings.paper_lamps,
                                report=report, steady=steady, memo=memo)
    content = model_cache.fingerprint(scene)
    if before and before.content == content and before.made_with == look.of_scene:
        return replace(before, state=state, framing=framing)
    encoded = None
    if len(scene) or scene.volumes:
        with progress.part(0.4, 0.5, "Loading the network"):
            network = model_cache.renderer(settings.weights, settings.device, settings.precision, settings.transformer)
        with progress.part(0.5, 1.0, "Bouncing light"):
            encoded = network.encode(scene, view.longer_side, draft=True)
    return Lit(state, look.of_scene, scene, framing, encoded, content)


def finished(lit: Lit) -> Lit:
    """Of a draft, the scene with the network's light."""
    with progress.part(0.0, 1.0, "Bouncing light"):
        return replace(lit, encoded=lit.encoded.finished())


def picture(lit: Lit, view: View, look: Look, divisor: int) -> tuple[np.ndarray, np.ndarray]:
    """(H, W, 4) f32 premultiplied linear Rec.709, row 0 on top, and (k, 3) places of what is seen, world.

    divisor: the level that it is of. At the finest several rays pass through each pixel, against jagged edges. Coarse
    ones, which others soon replace, have fewer rays of light.
    """
    smooth, effort = divisor == look.finest, QUICK if divisor >= COARSE and divisor != look.finest else FULL
    settings = look.frame
    with progress.part(0.0, 0.1, "Finding surfaces"):
        guides = cast_guides(lit.scene, view, SPREAD if smooth else CENTRE)
    if settings.guided:
        with progress.part(0.1, 0.2):
            guides = add_path_ends(guides, lit.scene, view, lit.rays)
    seen = guides.alpha > 0
    radiance = np.zeros_like(guides.position)
    if lit.encoded is not None and (seen.any() or lit.scene.volumes):
        with progress.part(0.2, 1.0, "Lighting the picture"):
            radiance = lit.encoded.view(view, guides, effort)
    opacity = None if settings.film_transparent else np.ones_like(guides.alpha)
    return output.composite(radiance, guides, opacity, None, settings.exposure), guides.position[seen]


def has_moved_on(lit: Lit, view: View, points: np.ndarray) -> bool:
    """Whether a view that shows these points (k, 3) is so far from the one that the scene was fitted to that it is to
    be fitted anew."""
    if not len(points):
        return False
    corners = lit.scene.triangles[~lit.scene.is_light].reshape(-1, 3)
    corners = corners if len(corners) else points
    own = fit_box((corners.min(axis=0), corners.max(axis=0)), points, view)
    return has_left(lit.framing.box, own)
