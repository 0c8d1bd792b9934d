# SPDX-License-Identifier: GPL-3.0-or-later
"""The stages of a frame with the amount of work of each."""
from __future__ import annotations

from typing import NamedTuple

import bpy

from .. import passes
from ..convert.camera.eyes import count_views
from ..frame_settings import FrameSettings, Light
from ..progress import stages
from ..progress.stages import Stage, Work
from ..render_size import render_border
from ..runtime import model_cache
from .optics import Optics


def count_layers(scene: bpy.types.Scene) -> int:
    """How many view layers this frame renders."""
    return 1 if scene.render.use_single_layer else sum(layer.use for layer in scene.view_layers)


class Pictures(NamedTuple):
    """What a view layer renders."""

    pixels: int       # of a view, inside the render border
    views: int        # of stereoscopy; Cycles renders all of them at once, the network one after the other
    with_lobes: bool  # the light of each lobe is requested
    groups: int       # light groups with a pass

    @classmethod
    def read(cls, depsgraph: bpy.types.Depsgraph, settings: FrameSettings, width: int, height: int) -> Pictures:
        """width, height: of the frame in pixels."""
        scene, layer = depsgraph.scene_eval, depsgraph.view_layer_eval
        x0, x1, y0, y1 = render_border(width, height, scene.render) or (0, width, 0, height)
        return cls((x1 - x0) * (y1 - y0), count_views(scene), passes.is_light_requested(layer, settings.light_passes),
                   len(passes.light_groups(layer, settings.light_passes)))


def stage_work(pictures: Pictures, settings: FrameSettings, optics: Optics) -> dict[Stage, Work]:
    """What the stages of one view layer have to do, in their units."""
    pixels, views, with_lobes, groups = pictures
    all_pixels = pixels * views
    rays, samples = all_pixels * optics.rays_of_picture(settings.sampling).most, optics.samples
    has_smooth_edges = settings.network.has_lobes and settings.light is Light.TRACED and not (
        optics or optics.shadow_catchers)
    encoded_scenes = optics.shutter_samples
    return {stages.CONVERT: Work(1, optics.scenes),
            stages.LOAD: Work(1, not model_cache.is_loaded()),
            stages.ALPHA: Work(rays, optics.holdouts),
            stages.CATCHERS: Work(rays, 2 * optics.shadow_catchers),
            stages.FIRST_HITS: Work(rays),
            stages.SAMPLE_HITS: Work(all_pixels * optics.rays_of_sample(settings.sampling).most,
                                     samples if optics else 0),
            stages.TEXTURES: Work(settings.token_budget, encoded_scenes * settings.network.encodes_textures),
            stages.ENCODE: Work(settings.token_budget, encoded_scenes),
            stages.VIEW: Work(pixels, samples * views),
            stages.GROUPS: Work(pixels * groups, samples * views if groups else 0),
            stages.EDGES: Work(pixels, has_smooth_edges * views),
            stages.DIVIDE: Work(pixels, with_lobes * views),
            stages.WRITE: Work(all_pixels),
            stages.REFERENCE: Work(all_pixels * settings.reference.samples if settings.reference else 0)}
