# SPDX-License-Identifier: GPL-3.0-or-later
"""Everything the add-on registers, in order, and taken back in the reverse order."""
from . import engine, model_cache, panels, settings
from .setup import package_operators, preferences, weights_operators

MODULES = (settings, preferences, engine, package_operators, weights_operators, panels)


def register() -> None:
    for module in MODULES:
        module.register()


def unregister() -> None:
    for module in reversed(MODULES):
        module.unregister()
    model_cache.free()
