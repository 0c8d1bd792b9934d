# SPDX-License-Identifier: GPL-3.0-or-later
"""No viewport goes blank: Rendered shading becomes Material Preview while our engine is chosen, and comes back."""
import bpy
import pytest

import addon_utils  # bpy puts it on the path
from bl_ext.user_default.renderformer_v2.rf2_engine import viewport

PACKAGE = "bl_ext.user_default.renderformer_v2"


@pytest.fixture
def view(scene):
    """The settings of a 3D viewport in Rendered shading, in a window that shows a scene of ours."""
    bpy.ops.wm.read_factory_settings()
    addon_utils.enable(PACKAGE)
    bpy.context.window_manager.windows[0].scene.render.engine = "RENDERFORMER_V2"
    view = shown()
    view.shading.type = "RENDERED"
    return view


def shown():
    return next(area.spaces.active for area in bpy.context.window_manager.windows[0].screen.areas
                if area.type == "VIEW_3D")


def choose(engine):
    bpy.context.window_manager.windows[0].scene.render.engine = engine
    viewport.put_back()  # what the message bus calls in a window


def test_rendered_shading_becomes_material_preview_and_comes_back(view):
    viewport.fall_back()
    assert view.shading.type == "MATERIAL"
    choose("CYCLES")
    assert view.shading.type == "RENDERED"


def test_what_the_user_chose_meanwhile_stays(view):
    viewport.fall_back()
    view.shading.type = "WIREFRAME"
    choose("CYCLES")
    assert view.shading.type == "WIREFRAME"


def test_workbench_in_between_loses_nothing(view):
    viewport.fall_back()
    choose("BLENDER_WORKBENCH")
    choose("CYCLES")
    assert view.shading.type == "RENDERED"


def test_other_engines_viewports_are_left_alone(view):
    choose("CYCLES")
    viewport.fall_back()
    assert view.shading.type == "RENDERED"


def test_a_saved_file_holds_what_the_user_chose(view, tmp_path):
    viewport.fall_back()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    assert view.shading.type == "RENDERED"  # without a window nothing asks for it to fall back again


def test_disabling_the_add_on_gives_rendered_shading_back(view):
    viewport.fall_back()
    addon_utils.disable(PACKAGE)
    try:
        bpy.context.window_manager.windows[0].scene.render.engine = "CYCLES"
        assert view.shading.type == "RENDERED"
    finally:
        addon_utils.enable(PACKAGE)
