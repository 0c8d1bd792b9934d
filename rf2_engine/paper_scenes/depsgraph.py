# SPDX-License-Identifier: GPL-3.0-or-later
"""Work on the depsgraph of a render, which Python can only reach while one runs."""
from __future__ import annotations

from collections.abc import Callable

import bpy

from ...model.errors import SceneError


def in_render(scene: bpy.types.Scene, work: Callable[[bpy.types.RenderEngine, bpy.types.Depsgraph], object]) -> object:
    """Call work(engine, depsgraph) where F12 would render the first enabled view layer, and return its result.

    Raises what `work` raises, and SceneError where Blender cannot render the scene. Settings are restored afterwards;
    the render result is a new, empty one.
    """
    outcome = []

    class Visitor(bpy.types.RenderEngine):
        """Renders nothing."""

        bl_idname = "RENDERFORMER_V2_VISITOR"
        bl_label = "RenderFormer-V2 Export"
        has_lost_modifiers = False  # read by cycles/evaluated_scene.py

        def render(self, depsgraph):
            if outcome:
                return  # one view layer is enough
            try:
                outcome.append((work(self, depsgraph), None))
            except Exception as error:  # Blender would print it and go on
                outcome.append((None, error))

    if scene.camera is None:
        raise SceneError(f'Scene "{scene.name}" has no camera: add one')
    render = scene.render
    before = {name: getattr(render, name) for name in ("engine", "use_compositing", "use_sequencer")}
    bpy.utils.register_class(Visitor)
    try:
        render.engine, render.use_compositing, render.use_sequencer = Visitor.bl_idname, False, False
        bpy.ops.render.render(scene=scene.name)
    except RuntimeError as error:
        raise SceneError(f'Scene "{scene.name}" cannot be rendered now ({" ".join(str(error).split())})') from error
    finally:
        for name, value in before.items():
            setattr(render, name, value)
        bpy.utils.unregister_class(Visitor)
    if not outcome:
        raise SceneError(f'Scene "{scene.name}" has no view layer that is enabled for rendering: switch on Use for '
                         "Rendering in View Layer Properties")
    result, error = outcome[0]
    if error is not None:
        raise error
    return result
