# SPDX-License-Identifier: GPL-3.0-or-later
"""Pairs of functions that register things and take them back, as bpy.utils.register_classes_factory makes them."""
from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

import bpy

Pair = tuple[Callable[[], None], Callable[[], None]]


def modules(in_order: tuple[ModuleType, ...]) -> Pair:
    """Of modules that have such functions, taken back in the reverse order."""
    def register() -> None:
        for module in in_order:
            module.register()

    def unregister() -> None:
        for module in reversed(in_order):
            module.unregister()

    return register, unregister


def handlers(*wanted: tuple[str, Callable]) -> Pair:
    """Of functions in lists of bpy.app.handlers: (name of the list, function), and so on."""
    def register() -> None:
        for name, handler in wanted:
            getattr(bpy.app.handlers, name).append(handler)

    def unregister() -> None:
        for name, handler in wanted:
            if handler in getattr(bpy.app.handlers, name):  # other add-ons clear these lists
                getattr(bpy.app.handlers, name).remove(handler)

    return register, unregister
