# SPDX-License-Identifier: GPL-3.0-or-later
"""The stages of a frame with the amount of work of each."""
from __future__ import annotations

import bpy

from ..progress import stages
from ..progress.stages import Stage, Work
from ..render_size import Border
from ..runtime import model_cache
from ..settings import FrameSettings, Light
from .optics import Optics


def layers(scene: bpy.types.Scene) -> int:
    """How many view layers this frame renders."""
    return 1 if scene.render.use_single_layer else sum(layer.use for layer in scene.view_layers)


def work(width: int, height: int, part: Border | None, settings: FrameSettings, optics: Optics,
         lit: bool, views: int = 1) -> dict[Stage, Work]:
    """What the stages of one view layer have to do, in their units. `lit`: the light of each lobe is wanted.

    views: of stereoscopy; Cycles renders all of them at once, the network one after the other.
    """
    x0, x1, y0, y1 = part or (0, width, 0, height)
    pixels = (x1 - x0) * (y1 - y0)
    seen = pixels * views
    rays, samples = seen * optics.rays_of_all(settings.guide_samples), optics.samples
    smooth = settings.guided and settings.light is Light.TRACED and not (optics or optics.catchers)
    return {stages.CONVERT: Work(1, optics.scenes),
            stages.LOAD: Work(1, not model_cache.is_loaded()),
            stages.ALPHA: Work(rays, optics.holes),
            stages.CATCHERS: Work(rays, 2 * optics.catchers),
            stages.FIRST_HITS: Work(rays),
            stages.SAMPLE_HITS: Work(seen * optics.rays_of_each(settings.guide_samples), samples if optics else 0),
            stages.TEXTURES: Work(settings.token_budget, 0 if settings.guided else optics.shutter),
            stages.ENCODE: Work(settings.token_budget, optics.shutter),
            stages.VIEW: Work(pixels, samples * views),
            stages.EDGES: Work(pixels, smooth * views),
            stages.DIVIDE: Work(pixels, lit * views),
            stages.WRITE: Work(seen),
            stages.REFERENCE: Work(seen * settings.reference.samples if settings.reference else 0)}
