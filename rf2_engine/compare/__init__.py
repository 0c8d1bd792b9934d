# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare in the Image Editor: any two passes, slots or loaded pictures, of any render engine."""
from ..registering import modules
from . import draw, events, operators, panel, settings, slots

MODULES = (settings, slots, events, operators, draw, panel)

register, unregister = modules(MODULES)
