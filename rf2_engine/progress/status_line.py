# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw our status line in the Image Editors that show a render, over Blender's, which Cycles sets while it runs.

Two threads must not set Blender's status text at once, and what Cycles says is about one of its runs alone.
"""
from __future__ import annotations

import blf
import bpy

SIZE = 11                    # of text, in pixels at an interface scale of 1
HEIGHT = 22                  # of a line
LEFT = 13
SHADE = (0.12, 0.12, 0.12, 1.0)

_text = ""
_handles: list = []


def show(text: str) -> None:
    """From any thread; an empty text takes the line away. Image Editors are drawn again as the render goes on."""
    global _text
    _text = text


def _draw() -> None:
    space = bpy.context.space_data
    if not _text or space.image is None or space.image.type != "RENDER_RESULT":
        return
    import gpu
    from gpu_extras.batch import batch_for_shader

    area, region, unit = bpy.context.area, bpy.context.region, bpy.context.preferences.system.ui_scale
    over = sum(r.height for r in area.regions if r.type in ("HEADER", "TOOL_HEADER") and r.height > 1 and
               r.y < region.y + region.height and r.alignment == "TOP")
    top = region.height - over
    bottom = top - HEIGHT * unit
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    gpu.state.blend_set("ALPHA")
    shader.uniform_float("color", SHADE)
    batch_for_shader(shader, "TRI_STRIP", {"pos": [(0, bottom), (region.width, bottom), (0, top), (region.width, top)]}
                     ).draw(shader)
    gpu.state.blend_set("NONE")
    blf.size(0, SIZE * unit)
    blf.color(0, 1, 1, 1, 1)
    blf.position(0, LEFT * unit, bottom + (HEIGHT - SIZE) * unit / 2 + 1, 0)
    blf.draw(0, _text)


def register() -> None:
    _handles.append(bpy.types.SpaceImageEditor.draw_handler_add(_draw, (), "WINDOW", "POST_PIXEL"))


def unregister() -> None:
    show("")
    while _handles:
        bpy.types.SpaceImageEditor.draw_handler_remove(_handles.pop(), "WINDOW")
