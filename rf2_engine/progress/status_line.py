# SPDX-License-Identifier: GPL-3.0-or-later
"""Our status line in the Image Editors that show a render, over Blender's, which Cycles sets while it runs.

Two threads must not set Blender's status text at once, and the text of Cycles is about one of its runs alone.
"""
from __future__ import annotations

import blf
import bpy

SIZE = 11                    # of text, in pixels at an interface scale of 1
HEIGHT = 22                  # of a line
LEFT = 13
SHADE = (0.12, 0.12, 0.12, 1.0)


class StatusLine:
    """The line, or none while its text is empty. There is one: `status_line`."""

    def __init__(self):
        self._text = ""
        self._handles: list = []

    def show(self, text: str) -> None:
        """Show a text, from any thread. Image Editors are drawn again as the render goes on."""
        self._text = text

    def register(self) -> None:
        self._handles.append(bpy.types.SpaceImageEditor.draw_handler_add(self._draw, (), "WINDOW", "POST_PIXEL"))

    def unregister(self) -> None:
        self.show("")
        while self._handles:
            bpy.types.SpaceImageEditor.draw_handler_remove(self._handles.pop(), "WINDOW")

    def _draw(self) -> None:
        space = bpy.context.space_data
        if self._text and space.image is not None and space.image.type == "RENDER_RESULT":
            _draw_text(self._text)


status_line = StatusLine()
register, unregister = status_line.register, status_line.unregister


def _draw_text(text: str) -> None:
    import gpu
    from gpu_extras.batch import batch_for_shader

    area, region, unit = bpy.context.area, bpy.context.region, bpy.context.preferences.system.ui_scale
    headers = sum(other.height for other in area.regions if other.type in ("HEADER", "TOOL_HEADER")
                  and other.height > 1 and other.y < region.y + region.height and other.alignment == "TOP")
    top = region.height - headers
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
    blf.draw(0, text)
