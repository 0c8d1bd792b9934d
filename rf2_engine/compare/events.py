# SPDX-License-Identifier: GPL-3.0-or-later
"""Read, measure and draw the comparison again after renders and after changes of the settings or the slot."""
from __future__ import annotations

import bpy
from bpy.app.handlers import persistent

from ..cycles import growing
from ..progress import last_render
from ..registering import handlers
from ..runtime.running import ENGINE
from ..setup import extension
from ..setup.display import redraw_areas
from . import fitting
from .state import comparison

TAB = "Compare"  # in the sidebar
INTERVAL = 0.2  # seconds between two checks of a timer


def read() -> None:
    """Read both pictures and begin to measure them."""
    comparison.read()
    redraw()
    if comparison.a:
        comparison.measurement = comparison.new_measurement()
        comparison.measurement.start()
        _call(_watch_measurement, INTERVAL)


def read_soon() -> None:
    """Read as soon as Blender is idle, if the comparison is shown."""
    if comparison.settings.show and not comparison.is_reading:
        _call(_read, 0.0)


def choose() -> None:
    """What to compare was chosen: by the user, unless it is being read."""
    if not comparison.is_reading:
        comparison.is_automatic = False
    read_soon()


def switch(show: bool) -> None:
    """Begin or end to compare."""
    fit_soon()
    comparison.is_automatic = False
    if show:
        read_soon()
        _call(_blink, 0.0)
    else:
        comparison.forget()
        redraw()


def fit_soon() -> None:
    """Zoom the editors as soon as Blender is idle, if two pictures side by side replace one, or one replaces two."""
    _call(_fit, 0.0)


def offer_reference() -> None:
    """Show a reference beside the picture from its first sample on; the user may switch it off again."""
    if not comparison.is_offered and _offers_reference():
        _call(_show_growing_reference, 0.0)
    comparison.is_offered = True


def open_tab_soon(area: bpy.types.Area) -> None:
    """Show our tab of the sidebar that an editor opens: it has tabs once it has been drawn."""
    def open_tab():
        for region in area.regions:
            if region.type == "UI":
                region.active_panel_category = TAB
    bpy.app.timers.register(open_tab, first_interval=INTERVAL)


def renders_reference(scene: bpy.types.Scene) -> bool:
    """Whether a render of this scene has a reference beside it."""
    return scene.render.engine == ENGINE and scene.renderformer_v2.reference.use


def redraw() -> None:
    redraw_areas("IMAGE_EDITOR")


def _read() -> float | None:
    if not comparison.settings.show:
        return None
    if bpy.app.is_job_running("RENDER"):
        return INTERVAL
    read()
    return None


def _fit() -> float | None:
    settings, size = comparison.settings, _picture_size()
    if comparison.is_reading or settings.show and size is None and not comparison.message:
        return INTERVAL
    is_for_two = settings.show and size is not None and settings.mode == "SIDE"
    if is_for_two != comparison.is_zoomed_for_two:
        comparison.is_zoomed_for_two = is_for_two
        fitting.fit(size if is_for_two else None)
    return None


def _picture_size() -> tuple[int, int] | None:
    """Width and height in pixels of either picture, as soon as there are two."""
    if comparison.a is not None:
        return comparison.a.pixels.shape[1::-1]
    return growing.size()


def _watch_measurement() -> float | None:
    redraw()
    return INTERVAL if comparison.measurement and comparison.measurement.is_running else None


def _blink() -> float | None:
    if not comparison.settings.show:
        return None
    if comparison.settings.mode == "BLINK":
        comparison.blinks_to_b = not comparison.blinks_to_b
        redraw()
    return comparison.settings.interval


def _call(action, seconds: float) -> None:
    if not bpy.app.timers.is_registered(action):
        bpy.app.timers.register(action, first_interval=seconds)


def _offers_reference() -> bool:
    preferences = extension.preferences()  # none where a script enabled the add-on
    return preferences is None or preferences.show_reference


def _show_growing_reference() -> None:
    comparison.show_reference()
    redraw()


def show_reference() -> float | None:
    """A timer: show the reference as soon as the render has ended."""
    if bpy.app.is_job_running("RENDER"):
        return INTERVAL
    comparison.show_reference()
    read_soon()
    return None


def _close() -> None:
    if comparison.is_automatic:
        comparison.settings.show = False


@persistent
def _begin_render(scene, *_):
    comparison.is_offered = False
    if comparison.is_automatic and not renders_reference(scene):
        _call(_close, 0.0)


@persistent
def _end_render(scene, *_):
    comparison.outdate()  # no more: this may be the thread of the render, and the editor is drawn again anyway
    has_reference = renders_reference(scene) and any(layer.reference_samples for layer in last_render.last_frame)
    if comparison.is_automatic and not has_reference:
        _call(_close, 0.0)
    if has_reference and not comparison.is_offered and _offers_reference():
        _call(show_reference, 0.0)


@persistent
def _load_file(*_):
    comparison.forget_all()
    comparison.settings.show = False


register, _remove_handlers = handlers(("render_init", _begin_render), ("render_complete", _end_render),
                                      ("render_cancel", _end_render), ("load_post", _load_file))


def unregister() -> None:
    _remove_handlers()
    for action in (_read, _fit, _watch_measurement, _blink, _show_growing_reference, show_reference, _close):
        if bpy.app.timers.is_registered(action):
            bpy.app.timers.unregister(action)
    comparison.reset()
