# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare in the Image Editor: any two passes, slots or loaded pictures, of any render engine."""
from . import draw, events, export, gizmo, operators, panel, settings

MODULES = (settings, events, operators, export, gizmo, draw, panel)


def register() -> None:
    for module in MODULES:
        module.register()


def unregister() -> None:
    for module in reversed(MODULES):
        module.unregister()
