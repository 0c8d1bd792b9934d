# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels, the line of the split and the scale of FLIP, drawn over the compared pictures."""
from __future__ import annotations

import textwrap

import blf

from ...model.metrics.flip import MAGMA
from .halves import free_width, middle
from .pictures import longest_pair
from .state import comparison

WHITE = (1.0, 1.0, 1.0, 1.0)
SHADE = (0.0, 0.0, 0.0, 0.6)
SIZE = 13            # of text, in pixels at an interface scale of 1
SCALE_WIDTH = 200
SPACE = 16           # pixels between two labels in a row, at an interface scale of 1


def draw(context, pairs: list[tuple[str, str]]) -> None:
    """Draw in pixels of the region, with labels of A and B: the first pair that has room, or else the last."""
    settings, unit = comparison.settings, context.preferences.system.ui_scale
    left, bottom, right, top = _visible_picture(context)
    _, end = free_width(context)
    if settings.mode == "SIDE":
        begin, half = free_width(context)[0], middle(context)
        left_b = left + half - begin
        _draw_box(half - unit / 2, 0, half + unit / 2, context.region.height, WHITE)
        a, b = longest_pair(pairs, lambda a, b: left + _width(a, unit) < half - SPACE * unit
                            and left_b + _width(b, unit) < end)
        _write(context, top, [[(left, a), (left_b, b)]])
    elif settings.mode == "SPLIT":
        draw_split(context, 1)

        def fit_in_one_row(a: str, b: str) -> bool:
            return left + _width(a, unit) + SPACE * unit + _width(b, unit) < right
        a, b = longest_pair(pairs, fit_in_one_row)
        row = [(left, a), (right - _width(b, unit), b)]
        _write(context, top, [row] if fit_in_one_row(a, b) else [[(left, a)], [(left, b)]])
    elif settings.mode == "BLINK":
        pair = longest_pair(pairs, lambda a, b: left + max(_width(a, unit), _width(b, unit)) < end)
        _write(context, top, [[(left, pair[comparison.blinks_to_b])]])
    elif settings.mode == "DIFFERENCE":
        _write_both(context, f"|A - B| x {settings.gain:g}", pairs)
    else:
        _draw_flip(context, pairs, right, max(bottom, 64 * unit))


def draw_message(context, message: str) -> None:
    """Say why there is no comparison."""
    unit = context.preferences.system.ui_scale
    left, _, _, top = _visible_picture(context)
    lines = textwrap.wrap(f"Compare: {message}", max(int((free_width(context)[1] - left) / _width("n", unit)), 20))
    _write(context, top, [[(left, text)] for text in lines])


def _draw_flip(context, pairs: list[tuple[str, str]], right: float, bottom: float) -> None:
    measurement = comparison.measurement
    if measurement and measurement.closeness:
        _write_both(context, f"FLIP {measurement.closeness.flip:.4f}", pairs)
        unit = context.preferences.system.ui_scale
        draw_scale(right, bottom - 24 * unit, unit)
    else:
        left, _, _, top = _visible_picture(context)
        _write(context, top, [[(left, measurement and measurement.error or "FLIP is being measured")]])


def _write_both(context, title: str, pairs: list[tuple[str, str]]) -> None:
    """A title and the labels, in one row if they fit, otherwise one below the other."""
    left, _, _, top = _visible_picture(context)
    unit, (_, end) = context.preferences.system.ui_scale, free_width(context)

    def row(a: str, b: str) -> str:
        return f"{title}    A: {a}    B: {b}"

    def fits(a: str, b: str) -> bool:
        return left + _width(row(a, b), unit) < end
    pair = longest_pair(pairs, fits)
    rows = [row(*pair)] if fits(*pair) else [title, f"A: {pair[0]}", f"B: {pair[1]}"]
    _write(context, top, [[(left, text)] for text in rows])


def _write(context, top: float, rows: list[list[tuple[float, str]]]) -> None:
    """Rows of (left, text) above `top`, but always below the header, however large the picture is drawn."""
    unit = context.preferences.system.ui_scale
    height = 2 * SIZE * unit
    lowest = min(top + 8 * unit, context.region.height - 48 * unit - height * (len(rows) - 1))
    for i, row in enumerate(reversed(rows)):
        for x, text in row:
            _draw_text(text, x, lowest + i * height, unit)


def _visible_picture(context) -> tuple[float, float, float, float]:
    """Left, bottom, right and top of the visible part of the picture, in pixels of the region."""
    view = context.region.view2d
    left, bottom = view.view_to_region(0, 0, clip=False)
    right, top = view.view_to_region(1, 1, clip=False)
    first, last = free_width(context)
    return max(left, first + 32), bottom, min(right, last), top


def split_x(context) -> float:
    """Position of the line of the split, in pixels of the region."""
    return context.region.view2d.view_to_region(comparison.settings.split, 0, clip=False)[0]


def draw_split(context, width: float) -> None:
    """Draw the line, `width` pixels wide at an interface scale of 1."""
    x, unit = split_x(context), context.preferences.system.ui_scale
    _, bottom = context.region.view2d.view_to_region(0, 0, clip=False)
    _, top = context.region.view2d.view_to_region(0, 1, clip=False)
    _draw_box(x - (width + 2) / 2 * unit, bottom, x + (width + 2) / 2 * unit, top, SHADE)
    _draw_box(x - width / 2 * unit, bottom, x + width / 2 * unit, top, WHITE)


def draw_scale(right: float, y: float, unit: float) -> None:
    """Draw FLIP's colours from 0 to 1, ending at `right`."""
    import gpu
    from gpu_extras.batch import batch_for_shader

    left, height = right - SCALE_WIDTH * unit, 12 * unit
    xs = [left + SCALE_WIDTH * unit * i / (len(MAGMA) - 1) for i in range(len(MAGMA))]
    corners = [(x, z) for x in xs for z in (y, y + height)]
    colors = [(*map(float, stop), 1.0) for stop in MAGMA for _ in range(2)]
    smooth = gpu.shader.from_builtin("SMOOTH_COLOR")
    batch_for_shader(smooth, "TRI_STRIP", {"pos": corners, "color": colors}).draw(smooth)
    for value in (0.0, 0.5, 1.0):
        text = f"{value:g}"
        _draw_text(text, left + value * SCALE_WIDTH * unit - _width(text, unit) / 2, y - 16 * unit, unit)


def _draw_box(left, bottom, right, top, color) -> None:
    import gpu
    from gpu_extras.batch import batch_for_shader

    gpu.state.blend_set("ALPHA")
    uniform = gpu.shader.from_builtin("UNIFORM_COLOR")
    batch = batch_for_shader(uniform, "TRI_STRIP",
                             {"pos": [(left, bottom), (right, bottom), (left, top), (right, top)]})
    uniform.uniform_float("color", color)
    batch.draw(uniform)
    gpu.state.blend_set("NONE")


def _width(text: str, unit: float) -> float:
    blf.size(0, SIZE * unit)
    return blf.dimensions(0, text)[0]


def _draw_text(text: str, x: float, y: float, unit: float) -> None:
    _draw_box(x - 4 * unit, y - 4 * unit, x + _width(text, unit) + 4 * unit, y + SIZE * unit, SHADE)
    blf.position(0, x, y, 0)
    blf.color(0, *WHITE)
    blf.draw(0, text)
