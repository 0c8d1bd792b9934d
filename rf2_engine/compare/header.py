# SPDX-License-Identifier: GPL-3.0-or-later
"""The view layer and the pass that the header of an Image Editor shows.

Python sees only their numbers. The numbers count in the order in which the engine announced the passes; the names come
from the saved file, which has them sorted.
"""
from __future__ import annotations

import bpy

from .. import exr, frame_settings
from .. import passes as pass_table

COMPOSITE = "Composite"  # the layer that the compositor writes


def numbers(image: bpy.types.Image) -> tuple[int, int, int]:
    """(layer, pass, view of stereoscopy) in the first Image Editor that shows the image, or else in a new one."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            space = area.spaces.active
            if area.type == "IMAGE_EDITOR" and space.image == image:
                user = space.image_user
                return user.multilayer_layer, user.multilayer_pass, user.multilayer_view
    return 0, 0, 0


def layers(file: exr.Multilayer, scene: bpy.types.Scene) -> list[str]:
    """The file's layers as the header lists them."""
    existing = dict.fromkeys(layer for layer, _ in file.passes)
    return [name for name in dict.fromkeys([COMPOSITE, *scene.view_layers.keys(), *existing]) if name in existing]


def passes(file: exr.Multilayer, layer: str, scene: bpy.types.Scene) -> list[str]:
    """The passes of a layer as the header lists them."""
    existing = dict.fromkeys(file.split_view(name)[0] for other, name in file.passes if other == layer)
    announced = _announced(file, scene.view_layers[layer], scene) if layer in scene.view_layers else []
    table = [p.blender_name for p in pass_table.PASSES]
    return [name for name in dict.fromkeys(["Combined", *announced, *table, *existing])
            if name in existing]


def shown(file: exr.Multilayer, image: bpy.types.Image, scene: bpy.types.Scene) -> tuple[str, str]:
    """(layer, pass) by name; the first layer or pass where the file has fewer."""
    layer_number, pass_number, _ = numbers(image)
    layer = _at(layers(file, scene), layer_number)
    return layer, _at(passes(file, layer, scene), pass_number)


def pass_in_view(file: exr.Multilayer, image: bpy.types.Image, layer: str, name: str) -> str:
    """The name of a pass in the view of stereoscopy that is shown; a name with a view in it stays as it is."""
    _, _, number = numbers(image)
    name_in_view = f"{name}.{file.views[number]}" if number < len(file.views) else name
    return name_in_view if (layer, name_in_view) in file.passes else name


def _at(names: list[str], number: int) -> str:
    return names[number if number < len(names) else 0] if names else ""


def _announced(file: exr.Multilayer, view_layer: bpy.types.ViewLayer, scene: bpy.types.Scene) -> list[str]:
    if "RenderFormer-V2 seconds" in file.metadata:
        enabled = pass_table.ticked_passes(view_layer, frame_settings.light_passes(scene), scene)
        return [p.blender_name for p in (*enabled, *pass_table.REFERENCE)]
    try:
        from cycles.engine import list_render_passes
        return [name for name, *_ in list_render_passes(scene, view_layer)]
    except (ImportError, AttributeError, TypeError):
        return []  # another version of Cycles
