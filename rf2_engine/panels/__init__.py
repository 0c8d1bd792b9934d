# SPDX-License-Identifier: GPL-3.0-or-later
"""Our panels, and Blender's ordinary panels for this engine; they stand in the order of registration."""
from ..registering import modules
from . import (
    blender_panels,
    camera,
    last_render,
    material,
    preflight,
    presets,
    reference,
    remarks,
    render_settings,
    view_layer,
)

register, unregister = modules((remarks, presets, render_settings, preflight, reference, last_render, view_layer,
                                material, camera, blender_panels))
