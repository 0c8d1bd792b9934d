# SPDX-License-Identifier: GPL-3.0-or-later
"""The built extension registers, shows Blender's panels for its engine, and leaves nothing behind."""
import subprocess
import sys

import bpy
import pytest

import addon_utils  # bpy puts it on the path
from bl_ext.user_default.renderformer_v2.rf2_engine.panels import adopted

PACKAGE = "bl_ext.user_default.renderformer_v2"


def _our_panels():
    return {p.__name__ for p in bpy.types.Panel.__subclasses__()
            if "RENDERFORMER_V2" in getattr(p, "COMPAT_ENGINES", ())}


def test_adopts_the_panels_a_user_expects(scene):
    expected = {"DATA_PT_lens", "DATA_PT_camera", "EEVEE_MATERIAL_PT_surface", "EEVEE_MATERIAL_PT_context_material",
                "EEVEE_WORLD_PT_surface", "RENDER_PT_output", "RENDER_PT_color_management", "VIEWLAYER_PT_layer"}
    assert expected <= _our_panels()


def test_shows_no_panel_that_does_nothing(scene):
    without_effect = {"DATA_PT_camera_stereoscopy", "RENDER_PT_stereoscopy", "EEVEE_MATERIAL_PT_viewport_settings",
                      "DATA_PT_lightprobe", "DATA_PT_EEVEE_light", "MATERIAL_PT_preview",
                      "DATA_PT_preview", "CYCLES_RENDER_PT_bake"}
    assert not _our_panels() & (without_effect | adopted.EXCLUDED)


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
