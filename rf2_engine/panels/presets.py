# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets of the engine's settings: some come with the add-on, and the user can add more."""
from __future__ import annotations

from functools import partial
from pathlib import Path

import bpy
from bl_operators.presets import AddPresetBase
from bl_ui.utils import PresetPanel

from ..registering import classes, pairs

IN_ORDER = ("Draft", "Normal", "Fine")
FOLDER = "renderformer_v2"                        # in every folder called presets
SHIPPED = str(Path(__file__).parents[1])          # contains such a folder


class RENDERFORMER_PT_presets(PresetPanel, bpy.types.Panel):
    bl_label = "RenderFormer-V2 Presets"
    preset_subdir = FOLDER
    preset_operator = "script.execute_preset"
    preset_add_operator = "renderformer_v2.add_preset"

    def path_menu(self, searchpaths, operator, *, add_operator=None, add_operator_props=None, **how):
        """Presets of the add-on, which cannot be removed, in the order of their cost; then the user's by name."""
        ours = [path for path in searchpaths if Path(path).is_relative_to(SHIPPED)]
        others = [path for path in searchpaths if path not in ours]
        for name in IN_ORDER:
            PresetPanel.path_menu(self, ours, operator, filter_path=f"{name}.py".__eq__, **how)
        PresetPanel.path_menu(self, others or ours, operator, filter_path=None if others else lambda file: False,
                              add_operator=add_operator, add_operator_props=add_operator_props, **how)


class RENDERFORMER_OT_add_preset(AddPresetBase, bpy.types.Operator):
    bl_idname = "renderformer_v2.add_preset"
    bl_label = "Add or Remove a RenderFormer-V2 Preset"
    bl_description = "Save the settings for detail, light and samples as a preset, or remove the active preset"
    preset_menu = "RENDERFORMER_PT_presets"
    preset_subdir = FOLDER
    preset_defines = ["settings = bpy.context.scene.renderformer_v2"]
    preset_values = [f"settings.{name}" for name in ("token_budget", "max_edge", "light", "guide_samples",
                                                     "use_adaptive_sampling", "adaptive_threshold",
                                                     "adaptive_min_samples", "precision")]


register, unregister = pairs(
    classes(RENDERFORMER_PT_presets, RENDERFORMER_OT_add_preset),
    (partial(bpy.utils.register_preset_path, SHIPPED), partial(bpy.utils.unregister_preset_path, SHIPPED)))
