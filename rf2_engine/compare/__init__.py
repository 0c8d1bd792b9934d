# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare in the Image Editor: any two passes, slots or loaded pictures, of any render engine."""
from ..registering import modules
from . import draw, events, export, gizmo, operators, panel, settings, windows

MODULES = (settings, windows, events, operators, export, gizmo, draw, panel)

register, unregister = modules(MODULES)
