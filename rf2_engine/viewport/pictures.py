# SPDX-License-Identifier: GPL-3.0-or-later
"""From the copy of a scene to pictures of it, on any thread: first hits by rays of our own, light by the network."""
from __future__ import annotations

from dataclasses import dataclass, replace

import bpy
import numpy as np

from ...model import progress
from ...model.first_hits.camera_rays import CENTER, SPREAD, cast_guides
from ...model.light.effort import FULL, QUICK
from ...model.light.specular.ends import add_path_ends
from ...model.light_groups import lit_by_negative
from ...model.scene import RenderScene, View
from ..convert.compute import compute
from ..convert.data.cache import ConversionCache
from ..convert.data.copied import CopiedScene
from ..convert.data.report import Report
from ..convert.fitting.framing import Framing, fit_box
from ..convert.shading.hit_materials import HitMaterials
from ..frame import output
from ..frame.light_subset import LightSubset
from ..frame.shot import has_left
from ..frame_settings import FrameSettings
from ..runtime import model_cache
from ..sampling import Sampling
from .source import State

COARSE = 4  # divisor from which on pictures are made quickly


@dataclass(frozen=True)
class ViewportSettings:
    """The settings that decide what a viewport shows."""

    frame: FrameSettings  # of a render, with the viewport's own Max Triangles
    finest: int           # smallest divisor of the pixels along a side
    time_limit: float     # seconds of one picture, 0 = any

    @classmethod
    def read(cls, scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> ViewportSettings:
        """Raises CheckpointError and SceneError as FrameSettings.read does."""
        own = scene.renderformer_v2.viewport
        frame = replace(FrameSettings.read(scene, view_layer), token_budget=own.token_budget, sampling=Sampling(1),
                        reference=None)
        return cls(frame, int(own.resolution), own.time_limit)

    @property
    def scene_key(self) -> tuple:
        """The settings that decide how a scene is converted and encoded."""
        frame = self.frame
        return (*frame.renderer, frame.network, frame.token_budget, frame.max_edge, frame.as_is, frame.paper_lamps)


@dataclass(eq=False, frozen=True)
class PreparedScene:
    """A scene that is ready for views of it."""

    state: State            # of the source that was copied
    settings: ViewportSettings  # that it was converted and encoded with
    scene: RenderScene
    framing: Framing
    encoded: object | None  # model.renderer.EncodedScene; None: there is nothing to light
    content: bytes          # model_cache.fingerprint
    hit_materials: HitMaterials   # of the scene
    negative: LightSubset | None = None  # lamps of negative strength, if it has any

    @property
    def is_draft(self) -> bool:
        return self.encoded is not None and self.encoded.is_draft

    @property
    def visible_corners(self) -> np.ndarray:
        """(k, 3) corners of the triangles that cameras see."""
        return self.scene.triangles[self.scene.is_seen].reshape(-1, 3)


def prepare_scene(copied: CopiedScene, state: State, view: View, settings: ViewportSettings,
                  before: PreparedScene | None, report: Report, cache: ConversionCache) -> PreparedScene:
    """Convert and encode a copy of a scene, for this view and those like it, as a draft where the network has drafts.

    before: the scene that was shown until now, whose box and shares of triangles stay as long as they fit.
    cache: of earlier conversions.
    """
    frame, framing, hit_materials = settings.frame, None, HitMaterials()

    def choose_framing(own: Framing) -> Framing:
        nonlocal framing
        framing = before.framing if before and before.settings.frame.as_is == frame.as_is and not has_left(
            before.framing.box, own.box) else own
        return framing

    with progress.part(0.0, 0.4, "Converting the scene"):
        scene = compute(copied, view, frame.conversion, report, choose_framing=choose_framing, cache=cache,
                        hit_materials=hit_materials)
    content = model_cache.fingerprint(scene)
    if before and before.content == content and before.settings.scene_key == settings.scene_key:
        return replace(before, state=state, framing=framing, hit_materials=hit_materials)
    encoded = negative = None
    if len(scene) or scene.volumes:
        with progress.part(0.4, 0.5, "Loading the network"):
            network = model_cache.renderer(*frame.renderer)
        with progress.part(0.5, 1.0, "Bouncing light"):
            encoded = network.encode(scene, view.longer_side, draft=True)
        if scene.negative is not None and frame.network.has_lobes:
            negative = LightSubset(network, scene, lit_by_negative(scene), view.longer_side)
    return PreparedScene(state, settings, scene, framing, encoded, content, hit_materials, negative)


def is_quick(divisor: int, settings: ViewportSettings) -> bool:
    """Whether pictures of this level are coarse ones that finer ones soon replace."""
    return divisor >= COARSE and divisor != settings.finest


def finish_draft(draft: PreparedScene) -> PreparedScene:
    """The scene of a draft with all of its light."""
    with progress.part(0.0, 1.0, "Bouncing light"):
        return replace(draft, encoded=draft.encoded.finished())


def render_picture(prepared: PreparedScene, view: View, settings: ViewportSettings,
                   divisor: int) -> tuple[np.ndarray, np.ndarray]:
    """(H, W, 4) f32 premultiplied linear Rec.709, row 0 on top, and (k, 3) positions of visible surfaces, world frame.

    divisor: the picture's level. At the finest one several rays pass through each pixel, against jagged edges. Coarse
    pictures, which others soon replace, have fewer rays of light, and materials as tiles show them.
    """
    is_finest, is_coarse, frame = divisor == settings.finest, is_quick(divisor, settings), settings.frame
    materials = prepared.hit_materials if frame.network.has_lobes and not is_coarse else None
    with progress.part(0.0, 0.1, "Finding surfaces"):
        guides = cast_guides(prepared.scene, view, SPREAD if is_finest else CENTER, materials)
    if frame.follows_specular_paths:
        with progress.part(0.1, 0.2):
            guides = add_path_ends(guides, prepared.scene, view)
    covered = guides.alpha > 0
    radiance = np.zeros_like(guides.position)
    if prepared.encoded is not None and (covered.any() or prepared.scene.volumes):
        with progress.part(0.2, 1.0, "Lighting the picture"):
            effort = QUICK if is_coarse else FULL
            radiance = prepared.encoded.view(view, guides, effort)
            if prepared.negative is not None:
                negative = prepared.negative.light(view, guides, frame.follows_specular_paths, effort=effort)
                radiance = (radiance - negative).clip(0)
    opacity = None if frame.film_transparent else np.ones_like(guides.alpha)
    return output.composite(radiance, guides, opacity, None, frame.exposure), guides.position[covered]


def needs_refit(prepared: PreparedScene, view: View, points: np.ndarray) -> bool:
    """Whether a view that shows these points (k, 3) is too far from the one that the scene was fitted to."""
    if not len(points):
        return False
    corners = prepared.scene.triangles[~prepared.scene.is_light].reshape(-1, 3)
    corners = corners if len(corners) else points
    own = fit_box((corners.min(axis=0), corners.max(axis=0)), points, view)
    return has_left(prepared.framing.box, own)
