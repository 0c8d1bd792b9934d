# SPDX-License-Identifier: GPL-3.0-or-later
"""Make pairs of functions that register and unregister things; of many things, all or none are registered."""
from __future__ import annotations

import traceback
from collections.abc import Callable
from functools import partial
from types import ModuleType

import bpy

Pair = tuple[Callable[[], object], Callable[[], object]]


def pairs(*in_order: Pair) -> Pair:
    """Registers pairs in order and unregisters them in reverse; if one fails, those before it are unregistered."""
    def register() -> None:
        done = []
        try:
            for do, undo in in_order:
                do()
                done.append(undo)
        except Exception:
            for undo in reversed(done):
                try:
                    undo()
                except Exception:  # the others are taken back all the same
                    traceback.print_exc()
            raise

    def unregister() -> None:
        for _, undo in reversed(in_order):
            undo()

    return register, unregister


def modules(in_order: tuple[ModuleType, ...]) -> Pair:
    """Registers modules by their functions `register` and `unregister`."""
    return pairs(*((module.register, module.unregister) for module in in_order))


def classes(*in_order: type) -> Pair:
    return pairs(*((partial(bpy.utils.register_class, cls), partial(bpy.utils.unregister_class, cls))
                   for cls in in_order))


def pointer(owner: type, name: str, settings: type) -> Pair:
    """Registers a property group of all data of one type, such as `scene.renderformer_v2`."""
    return (lambda: setattr(owner, name, bpy.props.PointerProperty(type=settings, name="RenderFormer-V2")),
            lambda: delattr(owner, name))


def appended(name: str, draw: Callable) -> Pair:
    """Appends a function to the panel, menu or header of Blender with that name, if there is one."""
    def call(method: str) -> None:
        if owner := getattr(bpy.types, name, None):
            getattr(owner, method)(draw)

    return partial(call, "append"), partial(call, "remove")


def handlers(*functions: tuple[str, Callable]) -> Pair:
    """register and unregister for functions in lists of bpy.app.handlers: (name of the list, function), and so on."""
    def register() -> None:
        for name, handler in functions:
            getattr(bpy.app.handlers, name).append(handler)

    def unregister() -> None:
        for name, handler in functions:
            if handler in getattr(bpy.app.handlers, name):  # other add-ons clear these lists
                getattr(bpy.app.handlers, name).remove(handler)

    return register, unregister
