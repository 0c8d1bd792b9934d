# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets of the engine's settings: some come with the add-on, and the user can add more."""
from __future__ import annotations

from functools import partial
from pathlib import Path

import bpy
from bl_operators.presets import AddPresetBase
from bl_ui.utils import PresetPanel

from ..registering import classes, pairs

FOLDER = "renderformer_v2"                        # under any folder called presets
SHIPPED = str(Path(__file__).parents[1])          # holds such a folder


class RENDERFORMER_PT_presets(PresetPanel, bpy.types.Panel):
    bl_label = "RenderFormer-V2 Presets"
    preset_subdir = FOLDER
    preset_operator = "script.execute_preset"
    preset_add_operator = "renderformer_v2.add_preset"


class RENDERFORMER_OT_add_preset(AddPresetBase, bpy.types.Operator):
    bl_idname = "renderformer_v2.add_preset"
    bl_label = "Add or Remove a RenderFormer-V2 Preset"
    bl_description = "Save the settings for detail, light and samples as a preset, or remove the active preset"
    preset_menu = "RENDERFORMER_PT_presets"
    preset_subdir = FOLDER
    preset_defines = ["settings = bpy.context.scene.renderformer_v2"]
    preset_values = [f"settings.{name}" for name in ("token_budget", "max_edge", "light", "guide_samples", "precision")]


register, unregister = pairs(
    classes(RENDERFORMER_PT_presets, RENDERFORMER_OT_add_preset),
    (partial(bpy.utils.register_preset_path, SHIPPED), partial(bpy.utils.unregister_preset_path, SHIPPED)))
