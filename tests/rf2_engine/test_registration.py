# SPDX-License-Identifier: GPL-3.0-or-later
"""The built extension registers, shows Blender's panels for its engine, and leaves nothing behind."""
import importlib
import subprocess
import sys

import bpy
import pytest
from bl_ui import properties_render

import addon_utils  # bpy puts it on the path
from bl_ext.user_default.renderformer_v2.rf2_engine import registration
from bl_ext.user_default.renderformer_v2.rf2_engine.panels import blender_panels
from cycles import ui

PACKAGE = "bl_ext.user_default.renderformer_v2"


def _our_panels():
    return {p.__name__ for p in bpy.types.Panel.__subclasses__()
            if "RENDERFORMER_V2" in getattr(p, "COMPAT_ENGINES", ())}


def _classes(of: type = bpy.types.bpy_struct) -> set[str]:
    """Names of the classes of ours that are registered."""
    below = (_classes(cls) for cls in of.__subclasses__())
    ours = of.__module__.startswith(PACKAGE) and "bl_rna" in vars(of)
    return set().union(*below) | ({of.__name__} if ours else set())


def _handlers() -> list:
    lists = (getattr(bpy.app.handlers, name) for name in dir(bpy.app.handlers))
    return [handler for listed in lists if isinstance(listed, list) for handler in listed
            if handler.__module__.startswith(PACKAGE)]


def test_adopts_the_panels_a_user_expects(scene):
    expected = {"DATA_PT_lens", "DATA_PT_camera", "EEVEE_MATERIAL_PT_surface", "EEVEE_MATERIAL_PT_context_material",
                "EEVEE_WORLD_PT_surface", "RENDER_PT_output", "RENDER_PT_color_management", "VIEWLAYER_PT_layer",
                "DATA_PT_camera_stereoscopy", "RENDER_PT_stereoscopy", "RENDER_PT_output_views"}
    assert expected <= _our_panels()


def test_shows_no_panel_that_does_nothing(scene):
    without_effect = {"EEVEE_MATERIAL_PT_viewport_settings",
                      "DATA_PT_lightprobe", "DATA_PT_EEVEE_light", "MATERIAL_PT_preview",
                      "DATA_PT_preview", "CYCLES_RENDER_PT_bake"}
    assert not _our_panels() & (without_effect | blender_panels.EXCLUDED)


def test_disabling_takes_everything_back_and_enabling_again_works(scene):
    scene.render.engine = "CYCLES"
    addon_utils.disable(PACKAGE)
    try:
        assert not _our_panels()
        assert not hasattr(bpy.types.Scene, "renderformer_v2")
        with pytest.raises(TypeError):
            scene.render.engine = "RENDERFORMER_V2"
    finally:
        addon_utils.enable(PACKAGE)
    assert hasattr(bpy.types.Scene, "renderformer_v2")


def test_registering_does_not_import_torch():
    code = ("import os, sys, bpy; sys.path.insert(0, os.getcwd()); from tools import extension; "
            "extension.load().register(); "
            "bad = {'torch', 'safetensors', 'fast_simplification', 'embreex'} & set(sys.modules); print(bad); "
            "sys.stdout.flush(); os._exit(bool(bad))")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("renamed", ["CYCLES_LIGHT_PT_light", "CYCLES_OBJECT_PT_visibility", "RENDER_PT_simplify"])
def test_a_panel_that_another_blender_has_renamed_is_left_out(scene, monkeypatch, renamed):
    """With those that stand in it; all others are shown."""
    addon_utils.disable(PACKAGE)
    try:
        monkeypatch.delattr(properties_render if renamed.startswith("RENDER") else ui, renamed)
        addon_utils.enable(PACKAGE)
        shown = _classes()
        assert hasattr(scene, "renderformer_v2") and "RENDERFORMER_CAMERA_PT_dof" in shown
        assert not any(name.startswith(blender_panels.our_name(renamed)) for name in shown)
    finally:
        addon_utils.disable(PACKAGE)
        monkeypatch.undo()
        addon_utils.enable(PACKAGE)
    assert blender_panels.our_name(renamed) in _classes()


@pytest.mark.parametrize("module, name", [("panels.render_settings", "RENDERFORMER_PT_motion_blur"),
                                          ("compare.panel", "RENDERFORMER_PT_compare_metrics")])
def test_what_was_registered_before_something_failed_is_taken_back(scene, monkeypatch, module, name):
    scene.render.engine = "CYCLES"
    refused = getattr(importlib.import_module(f"{PACKAGE}.rf2_engine.{module}"), name)
    addon_utils.disable(PACKAGE)
    try:
        monkeypatch.setattr(refused, "bl_space_type", "NOWHERE")
        with pytest.raises(Exception, match="NOWHERE"):
            registration.register()
        assert not _our_panels() and not _classes() and not _handlers()
        assert not hasattr(bpy.types.Scene, "renderformer_v2")
        assert not hasattr(bpy.types.WindowManager, "renderformer_v2_compare")
    finally:
        monkeypatch.undo()
        addon_utils.enable(PACKAGE)
    assert _our_panels() and name in _classes() and _handlers()
