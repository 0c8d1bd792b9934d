# SPDX-License-Identifier: GPL-3.0-or-later
"""Of the session: the panels of the Properties editor, and the add-on's preferences."""
import bpy
from driver import ESC, F12, area, is_rendering, middle, region
from rendering import FOLDER, driver, render

PROPERTIES = ("RENDER", "OUTPUT", "VIEW_LAYER", "WORLD", "OBJECT", "DATA", "MATERIAL")


def properties():
    """Every tab of the Properties editor, as far as it is seen."""
    space = area("PROPERTIES").spaces.active
    for name in PROPERTIES:
        space.context = name
        yield 0.7
        driver.shot(f"properties_{name.lower()}")


def preflight(found):
    """Looked at, and then outdated by a setting; what is said is drawn by panels, so it is in the screenshots."""
    from bl_ext.user_default.renderformer_v2.rf2_engine.frame import preflight as looked_at
    scene, space = bpy.context.scene, area("PROPERTIES").spaces.active
    space.context = "RENDER"
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0], area=area("PROPERTIES")):
        bpy.ops.renderformer_v2.preflight()
    yield 0.5
    latest = looked_at.last[scene.name]
    scene.renderformer_v2.guide_samples += 1
    found["preflight"] = [latest.lines, latest.state != looked_at.state_of(scene, bpy.context.view_layer)]
    yield 0.5
    driver.shot("preflight_outdated")
    scene.renderformer_v2.guide_samples -= 1


def refused(found):
    """Preflight refuses what a render refuses, in the same words, and the panel says it at once."""
    from bl_ext.user_default.renderformer_v2.rf2_engine.frame import preflight as looked_at
    from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render
    settings = bpy.context.scene.renderformer_v2
    empty = FOLDER / "empty"
    empty.mkdir()
    settings.weights_source, settings.weights_folder = "FOLDER", str(empty)
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0], area=area("PROPERTIES")):
        bpy.ops.renderformer_v2.preflight()
    yield 0.5
    driver.shot("refused")
    driver.key(F12)
    yield is_rendering
    yield lambda: not is_rendering()
    found["refused"] = [looked_at.last[bpy.context.scene.name].lines, last_render.last_frame[0].error]
    driver.move(*middle(region(area("VIEW_3D"))))  # its message may wait for something to happen
    yield 5.0
    driver.shot("refused_render")
    driver.key(ESC)  # the message that Blender shows takes all keys
    yield 0.5
    settings.weights_source = "BUNDLED"


def presets():
    """In the order of what they cost."""
    driver.move(*middle(region(area("VIEW_3D"))))
    yield 0.3
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0], area=area("VIEW_3D"),
                                   region=region(area("VIEW_3D"))):
        bpy.ops.wm.call_panel(name="RENDERFORMER_PT_presets", keep_open=True)
    yield 1.0
    driver.shot("presets")
    driver.key(ESC)
    yield 0.5


def report(editor, last_render, found):
    """What is said of many things is one line, in a panel that is open."""
    scene, space = bpy.context.scene, area("PROPERTIES").spaces.active
    for n in range(7):
        lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT"))
        lamp.data.cycles.max_bounces, lamp.location = 1, (n, -4, 3)
        scene.collection.objects.link(lamp)
    scene.renderformer_v2.reference.use = False
    yield from render(editor)
    closed = bpy.types.RENDERFORMER_PT_report
    bpy.utils.register_class(type("RENDERFORMER_PT_open_report", (closed,), {"bl_options": set()}))
    space.context = "RENDER"
    yield 1.0
    driver.shot("report")
    from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.report import grouped
    found["report"] = [str(group) for group in grouped(last_render.last_frame[0].remarks)]


def packages(editor):
    """The add-on's preferences, with what is missing."""
    editor.type = "PREFERENCES"
    bpy.context.preferences.active_section = "ADDONS"
    bpy.ops.preferences.addon_show(module="bl_ext.user_default.renderformer_v2")
    yield 2.0
    driver.shot("preferences")
