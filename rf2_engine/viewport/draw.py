# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw a picture and messages into a viewport. Blender adds overlays and its view transform."""
from __future__ import annotations

import textwrap

import blf
import bpy
import numpy as np

from ...model.pictures import HALF_MAX
from .region_view import Rectangle

SIZE = 13         # of text, in pixels at an interface scale of 1
HEIGHT = 20       # of a line
MARGIN = 40       # pixels at either side of text
COLOR = (1.0, 0.75, 0.35, 1.0)


class Texture:
    """The picture that was drawn last, on the graphics card."""

    def __init__(self) -> None:
        self.pixels: np.ndarray | None = None  # of it
        self._texture = None

    def draw(self, engine: bpy.types.RenderEngine, scene: bpy.types.Scene, pixels: np.ndarray,
             rectangle: Rectangle) -> None:
        """Pixels (H, W, 4) f32, premultiplied, scene-linear, row 0 on top, into a rectangle of the region."""
        import gpu
        from gpu_extras.presets import draw_texture_2d
        if self.pixels is not pixels:
            height, width = pixels.shape[:2]
            upwards = np.ascontiguousarray(pixels[::-1].clip(-HALF_MAX, HALF_MAX))
            buffer = gpu.types.Buffer("FLOAT", upwards.size, upwards.ravel())
            self.pixels, self._texture = pixels, gpu.types.GPUTexture((width, height), format="RGBA16F", data=buffer)
            if hasattr(self._texture, "filter_mode"):
                self._texture.filter_mode(True)
        x0, x1, y0, y1 = rectangle
        gpu.state.blend_set("ALPHA_PREMULT")
        engine.bind_display_space_shader(scene)
        draw_texture_2d(self._texture, (x0, y0), x1 - x0, y1 - y0)
        engine.unbind_display_space_shader()
        gpu.state.blend_set("NONE")


def draw_message(message: str, width: int, height: int) -> None:
    """Draw a few lines in the middle of a region of width x height pixels."""
    unit = bpy.context.preferences.system.ui_scale
    blf.size(0, SIZE * unit)
    blf.color(0, *COLOR)
    letter = max(blf.dimensions(0, "n")[0], 1)
    lines = textwrap.wrap(message, max(int((width - 2 * MARGIN * unit) / letter), 20))
    top = height / 2 + len(lines) * HEIGHT * unit / 2
    for i, line in enumerate(lines):
        blf.position(0, (width - blf.dimensions(0, line)[0]) / 2, top - (i + 1) * HEIGHT * unit, 0)
        blf.draw(0, line)
