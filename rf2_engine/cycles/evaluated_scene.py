# SPDX-License-Identifier: GPL-3.0-or-later
"""The evaluated scene around runs of Cycles: kept for another one, restored after one, moved in time."""
from __future__ import annotations

from contextlib import contextmanager

import bpy

SIMULATIONS = "CLOTH", "COLLISION", "DYNAMIC_PAINT", "FLUID", "SOFT_BODY"  # types of modifiers


@contextmanager
def keep_scene(engine: bpy.types.RenderEngine, runs_twice: bool):
    """Keep the evaluated scene inside, if `runs_twice`, so that Cycles can run twice in one `engine.render`.

    Cycles asks Blender to free it as soon as it has its own copy. Blender does not where Persistent Data is on, nor for
    an engine with a GPU context; that flag is looked at afresh each time, and we need no context.
    """
    engine.bl_use_gpu_context, engine.has_lost_modifiers = runs_twice, False
    try:
        yield
    finally:
        engine.bl_use_gpu_context = False


def survives(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph) -> bool:
    """Whether the evaluated scene will be there after a run: to touch a freed one crashes."""
    return engine.bl_use_gpu_context or depsgraph.scene_eval.render.use_persistent_data


def loses_modifiers(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph) -> bool:
    """Whether a run leaves the objects of a kept scene without their modifiers.

    Cycles throws away what modifiers made of objects where no window shows the scene meanwhile.
    """
    settings = depsgraph.scene_eval.render
    unwatched = bpy.app.background or settings.use_lock_interface
    return engine.bl_use_gpu_context and unwatched and not settings.use_persistent_data


def restore_objects(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph) -> None:
    """Evaluate the objects again, inside `keep_scene`, if the last run has left them without their modifiers."""
    if engine.has_lost_modifiers:
        engine.has_lost_modifiers = False
        for evaluated in depsgraph.objects:
            if not _is_simulated(evaluated.original):
                evaluated.original.update_tag(refresh={"DATA"})
        scene = depsgraph.scene_eval
        # A mere update would leave what is copied anew as the originals are: at the frame before an animation.
        evaluate_at(engine, depsgraph, scene.frame_current, scene.frame_subframe)


def evaluate_at(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, frame: int, subframe: float) -> None:
    """Evaluate the scene that is rendered at another time.

    Blender's function moves the user's scene along, which a timeline would show for as long as a picture takes.
    """
    users = depsgraph.scene
    frame_of_users, subframe_of_users = users.frame_current, users.frame_subframe
    engine.frame_set(frame, subframe)
    users.frame_current, users.frame_subframe = frame_of_users, subframe_of_users


def _is_simulated(obj: bpy.types.Object) -> bool:
    """Whether an object must not be tagged: Blender would throw away its simulations that are not baked, from disk too,
    and those of objects that collide with it. Time alone evaluates it again.
    """
    particles = any(system.settings.type != "HAIR" or system.use_hair_dynamics for system in obj.particle_systems)
    is_field = obj.field is not None and obj.field.type != "NONE"
    return particles or is_field or any(modifier.type in SIMULATIONS for modifier in obj.modifiers)
