# SPDX-License-Identifier: GPL-3.0-or-later
"""Our panels, and Blender's ordinary panels shown for this engine too; they stand in the order of registration."""
from ..registering import modules
from . import (
    adopted,
    camera,
    last_render,
    material,
    material_latent,
    passes,
    preflight,
    presets,
    reference,
    remarks,
    render_settings,
    view_layer,
    viewport,
)
from . import (
    copied as copied,
)

MODULES = (remarks, presets, render_settings, preflight, reference, last_render, viewport, passes, view_layer, material,
           material_latent, camera, copied, adopted)

register, unregister = modules(MODULES)
