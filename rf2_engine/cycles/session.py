# SPDX-License-Identifier: GPL-3.0-or-later
"""Render passes with Cycles inside our own engine, with exact first hits for any material.

Cycles computes the passes that our render result has and obeys render border, resolution percentage, view layer,
overrides and Esc by itself. It frees the evaluated scene when it ends (unless Persistent Data is on, or inside
`keep_scene`), so everything else must be read from the depsgraph before `render_views`.
"""
from __future__ import annotations

import bpy

from .. import passes as pass_table
from ..convert.data.report import Report
from ..frame_settings import Light
from ..setup import packages
from .overrides import overrides
from .run import Passes, run
from .session_options import SessionOptions
from .session_overrides import prepare_scene
from .session_passes import make_finite, separate_light


def render_passes(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, options: SessionOptions) -> Passes:
    """As `render_views`, for a render without stereoscopy."""
    passes, = render_views(engine, depsgraph, options, Report()).values()
    return passes


def render_views(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, options: SessionOptions,
                 report: Report) -> dict[str, Passes]:
    """Run one Cycles session for the view layer of `depsgraph` and return the passes of a final render, by view.

    `engine` is the RenderEngine inside whose `render` this is called.
    With Light.NONE no ray is cast towards a light and the result holds first-hit data only.
    With Light.TRACED it also holds "traced" (H, W, 3), the radiance of direct light and of what smooth mirrors and
    glass show, without directly visible emitters, denoised where Blender can, then also "noise" (H, W, 3), what the
    denoiser removed, and the light passes (never denoised) of passes.needed_light; where shadow catchers catch also
    "combined" as with Light.ALL.
    With Light.ALL the scene's own bounces are used and the result also holds "combined" and all light passes.
    Passes of light groups hold all light of the session, noisy, with the directly visible emitters and world, in a
    transparent film as well.

    Returns {view: {key of passes.PASSES: (H, W, C) f32}}, row 0 on top, for the render border only; plus "alpha"
    (H, W, 1), coverage, and "samples" (H, W, 1), how many a pixel has. The view is "" without
    stereoscopy. Colours are scene-linear and premultiplied by coverage. "combined" has no directly visible world: add
    "environment" for an opaque film. "depth" and "position" belong to the pixel centre (Cycles writes them for its
    first sample alone, which it puts there): 1e10 and 0 where that ray hits nothing. "normal" and the colours are sums
    over the samples that hit something, divided by all samples.

    Raises RenderCancelled after Esc, SceneError when Cycles is switched off or stops with an error.
    """
    packages.require_cycles()
    if options.light is Light.NONE:  # Cycles takes unlit surfaces for clean, whatever their edges are
        options = options._replace(sampling=options.sampling.fixed)
    layer = depsgraph.view_layer_eval.name
    requested = _requested_passes(depsgraph.view_layer_eval, options)
    for p in requested:  # those that were registered are there already, and stay as they are
        engine.add_pass(p.blender_name, len(p.channels), p.channels, layer=layer)
    with overrides(engine, depsgraph) as override:
        prepare_scene(engine, depsgraph, options, override)
        views = run(engine, depsgraph, layer, requested, override.changes, report)
    for rendered in views.values():
        make_finite(rendered, report)
        separate_light(rendered, options)
    return views


def _requested_passes(view_layer: bpy.types.ViewLayer, options: SessionOptions) -> list[pass_table.Pass]:
    lobes = {Light.ALL: pass_table.LIGHTING, Light.NONE: (),
             Light.TRACED: pass_table.needed_light(view_layer, pass_table.LIGHTING)}[options.light]
    noisy = pass_table.NOISY
    requested = [p for p in pass_table.session_passes(view_layer, lobes) if p != noisy]
    requested += [noisy] * options.is_denoised + [*options.groups]
    if options.catches_shadows and pass_table.SHADOW_CATCHER.is_ticked(view_layer):
        requested.append(pass_table.SHADOW_CATCHER)
    if options.sampling.is_adaptive and pass_table.SAMPLE_COUNT not in requested:
        requested.append(pass_table.SAMPLE_COUNT)
    return requested
