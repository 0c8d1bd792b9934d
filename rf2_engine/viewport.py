# SPDX-License-Identifier: GPL-3.0-or-later
"""Viewports in Rendered shading show Material Preview: there is no Rendered viewport of our own yet.

Blender asks the engine to draw such a viewport, and without an answer its surfaces vanish. What the user chose comes
back when another engine is chosen, and is what a saved file holds.
"""
from __future__ import annotations

from collections.abc import Iterator

import bpy
from bpy.app.handlers import persistent

from .registering import handlers

ENGINE = "RENDERFORMER_V2"

_fallen: set[int] = set()  # addresses of the 3D viewports' settings that were Rendered
_subscriber = object()


def ask_to_fall_back() -> None:
    """To be called while a viewport is drawn, when nothing may be changed."""
    if not bpy.app.timers.is_registered(fall_back):
        bpy.app.timers.register(fall_back, first_interval=0.0)


def fall_back() -> None:
    """Put Material Preview into the Rendered viewports of every window that shows a scene of ours."""
    for window in bpy.context.window_manager.windows:
        if window.scene.render.engine == ENGINE:
            for space in _viewports(window.screen):
                if space.shading.type == "RENDERED":
                    space.shading.type = "MATERIAL"
                    _fallen.add(space.as_pointer())


def put_back() -> None:
    """Give the viewports back what `fall_back` took, unless the user has chosen something else since."""
    for screen in bpy.data.screens:
        for space in _viewports(screen):
            if space.as_pointer() in _fallen and space.shading.type == "MATERIAL":  # Workbench has none
                space.shading.type = "RENDERED"
                _fallen.discard(space.as_pointer())


def _viewports(screen: bpy.types.Screen) -> Iterator[bpy.types.SpaceView3D]:
    for area in screen.areas:
        for space in area.spaces:
            if space.type == "VIEW_3D":
                yield space


@persistent
def _forget(*_):
    _fallen.clear()


@persistent
def _loaded(*_):
    _subscribe()


@persistent
def _before_saving(*_):
    put_back()


@persistent
def _after_saving(*_):
    if not bpy.app.background:
        ask_to_fall_back()


_add_handlers, _remove_handlers = handlers(("load_pre", _forget), ("load_post", _loaded),
                                           ("save_pre", _before_saving), ("save_post", _after_saving))


def _subscribe() -> None:
    bpy.msgbus.clear_by_owner(_subscriber)
    bpy.msgbus.subscribe_rna(key=(bpy.types.RenderSettings, "engine"), owner=_subscriber, args=(),
                             notify=put_back)  # viewports of other scenes of ours ask again when they are drawn


def register() -> None:
    _add_handlers()
    _subscribe()


def unregister() -> None:
    bpy.msgbus.clear_by_owner(_subscriber)
    _remove_handlers()
    if bpy.app.timers.is_registered(fall_back):
        bpy.app.timers.unregister(fall_back)
    put_back()
    _fallen.clear()
