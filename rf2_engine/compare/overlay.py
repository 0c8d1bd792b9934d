# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw names, the line of the split and the scale of FLIP over the compared pictures."""
from __future__ import annotations

import textwrap

import blf

from ...model.metrics.flip import MAGMA
from . import comparison, events, labels

WHITE = (1.0, 1.0, 1.0, 1.0)
SHADE = (0.0, 0.0, 0.0, 0.6)
SIZE = 13            # of text, in pixels at an interface scale of 1
SCALE_WIDTH = 200
ICONS = 56           # pixels of Blender's own gizmos at the right edge, at an interface scale of 1
SPACE = 16           # pixels between two names in a row, at an interface scale of 1
GAP = 0.02           # between pictures side by side, of their width


def draw(context, names: list[tuple[str, str]]) -> None:
    """In pixels of the region, with names of A and B: the first pair that has room, or else the last."""
    chosen, unit = comparison.settings(), context.preferences.system.ui_scale
    left, bottom, right, top = _place(context)
    _, end = free(context)
    if chosen.mode == "SIDE":
        beside = context.region.view2d.view_to_region(1 + GAP, 1, clip=False)[0]
        a, b = labels.longest(names, lambda a, b: left + _width(a, unit) < beside - SPACE * unit
                              and beside + _width(b, unit) < end)
        _write(context, top, [[(left, a), (beside, b)]])
    elif chosen.mode == "SPLIT":
        draw_split(context, 1)

        def beside_each_other(a: str, b: str) -> bool:
            return left + _width(a, unit) + SPACE * unit + _width(b, unit) < right
        a, b = labels.longest(names, beside_each_other)
        beside = [(left, a), (right - _width(b, unit), b)]
        _write(context, top, [beside] if beside_each_other(a, b) else [[(left, a)], [(left, b)]])
    elif chosen.mode == "BLINK":
        pair = labels.longest(names, lambda a, b: left + max(_width(a, unit), _width(b, unit)) < end)
        _write(context, top, [[(left, pair[events.blink])]])
    elif chosen.mode == "DIFFERENCE":
        _write_both(context, f"|A - B| x {chosen.gain:g}", names)
    else:
        _flip(context, names, right, max(bottom, 64 * unit))


def _write_both(context, head: str, names: list[tuple[str, str]]) -> None:
    """In one row, or in a row each."""
    left, _, _, top = _place(context)
    unit, (_, end) = context.preferences.system.ui_scale, free(context)

    def row(a: str, b: str) -> str:
        return f"{head}    A: {a}    B: {b}"

    def fits(a: str, b: str) -> bool:
        return left + _width(row(a, b), unit) < end
    pair = labels.longest(names, fits)
    rows = [row(*pair)] if fits(*pair) else [head, f"A: {pair[0]}", f"B: {pair[1]}"]
    _write(context, top, [[(left, text)] for text in rows])


def say(context, message: str) -> None:
    """Instead of a comparison."""
    unit = context.preferences.system.ui_scale
    left, _, _, top = _place(context)
    lines = textwrap.wrap(f"Compare: {message}", max(int((free(context)[1] - left) / _width("n", unit)), 20))
    _write(context, top, [[(left, text)] for text in lines])


def _write(context, top: float, rows: list[list[tuple[float, str]]]) -> None:
    """Texts above `top`, each from an x on; below the header, however large the picture is."""
    unit = context.preferences.system.ui_scale
    height = 2 * SIZE * unit
    line = min(top + 8 * unit, context.region.height - 48 * unit - height * (len(rows) - 1))
    for above, row in enumerate(reversed(rows)):
        for x, text in row:
            _text(text, x, line + above * height, unit)


def _place(context) -> tuple[float, float, float, float]:
    """Left, bottom, right and top of what is seen of the picture, in pixels of the region."""
    view = context.region.view2d
    left, bottom = view.view_to_region(0, 0, clip=False)
    right, top = view.view_to_region(1, 1, clip=False)
    first, last = free(context)
    return max(left, first + 32), bottom, min(right, last), top


def free(context) -> tuple[float, float]:
    """Left and right end of what toolbar, sidebar and Blender's gizmos leave of the region, in its pixels."""
    left, right = 0, context.region.width
    for other in context.area.regions:
        if other.width > 1 and other.type == "TOOLS":
            left = max(left, other.x + other.width - context.region.x)
        elif other.width > 1 and other.type == "UI":
            right = min(right, other.x - context.region.x)
    return left, right - ICONS * context.preferences.system.ui_scale


def _flip(context, names, right, bottom) -> None:
    measured = comparison.measurement
    if measured and measured.closeness:
        _write_both(context, f"FLIP {measured.closeness.flip:.4f}", names)
        unit = context.preferences.system.ui_scale
        draw_scale(right, bottom - 24 * unit, unit)
    else:
        left, _, _, top = _place(context)
        _write(context, top, [[(left, measured and measured.error or "FLIP is being measured")]])


def split_x(context) -> float:
    """Where the line of the split is, in pixels of the region."""
    return context.region.view2d.view_to_region(comparison.settings().split, 0, clip=False)[0]


def draw_split(context, width: float) -> None:
    """The line, `width` pixels wide at an interface scale of 1."""
    x, unit = split_x(context), context.preferences.system.ui_scale
    _, bottom = context.region.view2d.view_to_region(0, 0, clip=False)
    _, top = context.region.view2d.view_to_region(0, 1, clip=False)
    _box(x - (width + 2) / 2 * unit, bottom, x + (width + 2) / 2 * unit, top, SHADE)
    _box(x - width / 2 * unit, bottom, x + width / 2 * unit, top, WHITE)


def draw_scale(right: float, y: float, unit: float) -> None:
    """FLIP's colours from 0 to 1, their right end at `right`."""
    import gpu
    from gpu_extras.batch import batch_for_shader

    left, height = right - SCALE_WIDTH * unit, 12 * unit
    places = [left + SCALE_WIDTH * unit * i / (len(MAGMA) - 1) for i in range(len(MAGMA))]
    corners = [(x, z) for x in places for z in (y, y + height)]
    colors = [(*map(float, stop), 1.0) for stop in MAGMA for _ in range(2)]
    smooth = gpu.shader.from_builtin("SMOOTH_COLOR")
    batch_for_shader(smooth, "TRI_STRIP", {"pos": corners, "color": colors}).draw(smooth)
    for value in (0.0, 0.5, 1.0):
        text = f"{value:g}"
        _text(text, left + value * SCALE_WIDTH * unit - _width(text, unit) / 2, y - 16 * unit, unit)


def _box(left, bottom, right, top, color) -> None:
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


def _text(text: str, x: float, y: float, unit: float) -> None:
    _box(x - 4 * unit, y - 4 * unit, x + _width(text, unit) + 4 * unit, y + SIZE * unit, SHADE)
    blf.position(0, x, y, 0)
    blf.color(0, *WHITE)
    blf.draw(0, text)
