# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets that come with the add-on, and those of the user."""
import types
from pathlib import Path

import bpy
import pytest
from bl_ui.utils import PresetPanel

from bl_ext.user_default.renderformer_v2.rf2_engine.panels import presets

SETTINGS = ("token_budget", "max_edge", "light", "guide_samples", "use_adaptive_sampling", "adaptive_threshold",
            "adaptive_min_samples", "precision")


def shipped() -> list[Path]:
    return [path for folder in bpy.utils.preset_paths("renderformer_v2") for path in sorted(Path(folder).glob("*.py"))]


@pytest.mark.parametrize("name", ["Draft", "Normal", "Fine"])
def test_shipped_presets_set_what_they_say(scene, name):
    (path,) = [path for path in shipped() if path.stem == name]
    settings = scene.renderformer_v2
    settings.guide_samples = 1000
    bpy.ops.script.execute_preset(filepath=str(path), menu_idname="RENDERFORMER_PT_presets")
    assert settings.guide_samples < 1000


def test_presets_stand_in_the_order_of_what_they_cost_and_the_users_follow(scene):
    bpy.ops.renderformer_v2.add_preset(name="Always")
    shown = []

    class Layout:
        def operator(self, name, text="", **_):
            shown.append(text)
            return types.SimpleNamespace()

        def __getattr__(self, name):
            return lambda *_, **__: self
    panel_class = presets.RENDERFORMER_PT_presets
    panel = type("Panel", (PresetPanel,), {
        name: value for name, value in vars(panel_class).items()
        if name.startswith(("preset_", "path_menu"))} | {"layout": Layout(), "bl_idname": ""})()
    panel_class.draw(panel, bpy.context)
    bpy.ops.renderformer_v2.add_preset(name="Always", remove_name=True)
    assert [text for text in shown if text] == ["Draft", "Normal", "Fine", "Always"]


def test_the_normal_preset_is_what_a_new_scene_has(scene):
    (path,) = [path for path in shipped() if path.stem == "Normal"]
    bpy.ops.script.execute_preset(filepath=str(path), menu_idname="RENDERFORMER_PT_presets")
    properties = scene.renderformer_v2.bl_rna.properties
    assert [getattr(scene.renderformer_v2, name) for name in SETTINGS] == pytest.approx(
        [properties[name].default for name in SETTINGS])


def test_a_user_keeps_settings_under_a_name(scene):
    settings = scene.renderformer_v2
    settings.token_budget, settings.light = 777, "NETWORK"
    bpy.ops.renderformer_v2.add_preset(name="Mine")
    (path,) = [path for path in shipped() if path.stem == "Mine"]
    settings.token_budget, settings.light = 5000, "TRACED"
    bpy.ops.script.execute_preset(filepath=str(path), menu_idname="RENDERFORMER_PT_presets")
    assert (settings.token_budget, settings.light) == (777, "NETWORK")
