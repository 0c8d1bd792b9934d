# SPDX-License-Identifier: GPL-3.0-or-later
"""What a user does in Blender's window from enabling the add-on on: `blender --python session.py -- ZIP FOLDER`."""
import sys
from pathlib import Path

import bpy
import numpy as np

sys.path.append(str(Path(__file__).parent))
from driver import ESC, F12, area, is_rendering, middle, region  # noqa: E402  it lies beside this file
from interface import packages, preflight, presets, properties, refused, report  # noqa: E402
from references import both, slots, stop_elsewhere, stop_reference  # noqa: E402
from rendering import ARCHIVE, FOLDER, driver, lines, render, stages, watch  # noqa: E402

STAGES = ("Converting the scene", "Camera rays", "Network", "Cycles Reference")


def session():
    found = driver.found
    bpy.ops.extensions.package_install_files(filepath=str(ARCHIVE), repo="user_default", enable_on_install=True)
    from bl_ext.user_default.renderformer_v2.rf2_engine.compare.state import comparison
    from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render
    watch()
    scene = bpy.context.scene
    shading = area("VIEW_3D").spaces.active.shading
    shading.type = "RENDERED"
    yield 1.0
    scene.render.engine = "RENDERFORMER_V2"
    yield 5.0
    driver.shot("rendered_viewport")
    scene.render.resolution_x, scene.render.resolution_y = 400, 300
    reference = scene.renderformer_v2.reference
    reference.use, reference.samples, reference.use_denoising = True, 64, False
    scene.renderformer_v2.precision, scene.cycles.use_adaptive_sampling = "fp32", False
    scene.renderformer_v2.max_edge = 1.0  # few triangles: this is about the window
    yield 1.0
    driver.shot("engine")
    yield from preflight(found)
    yield from refused(found)
    yield from presets()
    yield from properties()

    area("VIEW_3D").type = "IMAGE_EDITOR"
    yield 1.0
    editor = area("IMAGE_EDITOR")
    editor.spaces.active.image = next(i for i in bpy.data.images if i.type == "RENDER_RESULT") if any(
        i.type == "RENDER_RESULT" for i in bpy.data.images) else None
    editor.spaces.active.show_region_ui = True
    driver.move(*middle(region(editor)))
    yield 0.5
    yield from render(editor, shots=True)
    found["lines"] = sorted(set(lines), key=lines.index)
    found["reference_samples"] = last_render.last_frame[0].reference_samples
    yield from both(comparison, found)
    yield from compare(editor, comparison, found)
    yield from stop_reference(editor, comparison, last_render, found)
    yield from stop_reference(editor, comparison, last_render, found, region_of_frame=(0.3, 0.8, 0.25, 0.7))
    yield from slots(editor, comparison, last_render, found)
    yield from escape(editor, last_render, found)
    yield from reopen(editor, comparison, found)
    yield from hostile(editor, comparison, last_render, found)
    yield from elsewhere(editor, last_render, found)
    yield from report(editor, last_render, found)
    yield from packages(editor)


def compare(editor, comparison, found):
    chosen = comparison.settings
    editor.regions.update()
    region(editor, "UI").active_panel_category = "Compare"
    chosen.show = True
    yield lambda: comparison.measurement is not None and comparison.measurement.closeness is not None
    yield 1.0
    driver.shot("split")
    from bl_ext.user_default.renderformer_v2.rf2_engine.compare import overlay
    space = region(editor)
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0], area=editor, region=space):
        x = overlay.split_x(bpy.context)
    driver.move(space.x + x, middle(space)[1])
    yield 0.5
    driver.press()
    yield 0.3
    for i in range(1, 9):
        driver.move(space.x + x + 10 * i, middle(space)[1])
        yield 0.1
    driver.press(False)
    yield 0.5
    driver.shot("split_dragged")
    found["split"] = chosen.split
    for mode in ("SIDE", "BLINK", "DIFFERENCE", "FLIP"):
        chosen.mode = mode
        chosen.gain = 10
        yield 1.0
        driver.shot(f"compare_{mode.lower()}")
    editor.spaces.active.show_region_ui, chosen.mode = False, "SPLIT"
    yield 1.0
    chosen.mode = "SIDE"
    yield 1.0
    driver.shot("compare_side_without_sidebar")
    editor.spaces.active.show_region_ui, chosen.mode = True, "SPLIT"
    yield 1.0
    path = FOLDER / "sheet.png"
    bpy.ops.renderformer_v2.compare_export(filepath=str(path))
    found["exported"] = [each.is_file() for each in (path, path.with_suffix(".json"))]
    found["closeness"] = comparison.measurement.closeness.psnr
    yield from drawn(editor, comparison, found)
    chosen.show = False


def drawn(editor, comparison, found):
    """Compare shows what Blender shows, near and far, and no file has any of it."""
    chosen, image, found["off"] = comparison.settings, editor.spaces.active.image, []
    image.save_render(str(FOLDER / "compared.png"))
    chosen.mode, chosen.split = "SPLIT", 1.0
    driver.move(*middle(region(area("DOPESHEET_EDITOR"))))
    for zoom in (1.0, 3.7):
        with bpy.context.temp_override(window=bpy.context.window_manager.windows[0], area=editor,
                                       region=region(editor)):
            bpy.ops.image.view_zoom_ratio(ratio=zoom)
        chosen.show = True
        yield lambda: comparison.a is not None
        yield 1.0
        compared = driver.pixels("all_of_a", region(editor))
        chosen.show = False
        yield 1.0
        plain = driver.pixels("plain", region(editor))
        found["off"].append(float(np.abs(compared - plain).mean()))
    found["contrast"] = float(np.ptp(plain))
    image.save_render(str(FOLDER / "alone.png"))
    found["saved_alike"] = (FOLDER / "compared.png").read_bytes() == (FOLDER / "alone.png").read_bytes()
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0], area=editor, region=region(editor)):
        bpy.ops.image.view_zoom_ratio(ratio=1.0)


def escape(editor, last_render, found):
    """Esc in each stage: ours is gone before the reference, and stays after it."""
    found["escaped"] = {}
    for stage in STAGES:
        stages.clear()
        driver.move(*middle(region(editor)))
        driver.key(F12)
        yield lambda stage=stage: stage in stages
        driver.key(ESC)
        yield lambda: not is_rendering()
        yield 1.0
        (last,) = last_render.last_frame
        found["escaped"][stage] = "cancelled" if last.cancelled else last.report
        driver.shot(f"esc_{stage.split()[0].lower()}")


def reopen(editor, comparison, found):
    """The saved file against the render result that it was saved from."""
    yield from render(editor)
    path = FOLDER / "passes.exr"
    from bl_ext.user_default.renderformer_v2.rf2_engine import compat
    image = next(i for i in bpy.data.images if i.type == "RENDER_RESULT")
    compat.set_file_format(bpy.context.scene.render.image_settings, "OPEN_EXR_MULTILAYER")
    bpy.context.scene.render.image_settings.color_depth = "32"
    image.save_render(str(path))
    loaded = bpy.data.images.load(str(path))
    editor.spaces.active.image = loaded
    chosen = comparison.settings
    chosen.a.kind = chosen.b.kind = "IMAGE"
    chosen.a.image = chosen.b.image = loaded.name
    chosen.a.pass_name, chosen.b.pass_name, chosen.mode, chosen.show = "Combined", "Cycles Reference", "SPLIT", True
    yield lambda: comparison.measurement is not None and comparison.measurement.closeness is not None
    yield 1.0
    driver.shot("loaded_file")
    of_file = comparison.a.pixels.copy()
    chosen.a.kind = "SHOWN"
    yield lambda: comparison.a is not None and "Slot" in comparison.a.name
    found["file_is_the_render"] = bool(np.array_equal(of_file, comparison.a.pixels))


def hostile(editor, comparison, last_render, found):
    """What is compared goes away, and the engine changes under a render."""
    chosen, scene = comparison.settings, bpy.context.scene
    said = found["said"] = {}
    image = next(i for i in bpy.data.images if i.type == "RENDER_RESULT")
    editor.spaces.active.image = image

    def hears(name):
        yield lambda: comparison.message
        said[name] = comparison.message
        driver.shot(name)
    chosen.b.image = "gone"
    yield from hears("image_is_gone")
    for side, slot in ((chosen.a, 1), (chosen.b, 2)):
        side.kind, side.slot, side.pass_name = "SLOT", slot, "Combined"
    image.render_slots.active_index, scene.render.resolution_x = 1, 200
    yield from render(editor)
    yield from hears("other_size")
    chosen.a.slot, chosen.b.pass_name = 2, "Cycles Reference"
    yield lambda: comparison.a is not None
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0], area=editor, region=region(editor)):
        bpy.ops.image.remove_render_slot()
    yield from hears("slot_removed")
    stages.clear()
    driver.key(F12)
    yield lambda: "Camera rays" in stages
    scene.render.engine = "CYCLES"
    yield lambda: not is_rendering()
    scene.render.engine = "RENDERFORMER_V2"
    found["engine_changed"] = [last_render.last_frame[0].error, last_render.last_frame[0].reference_samples]
    chosen.show = False


def elsewhere(editor, last_render, found):
    """Cycles' functions have gone; the user goes on working meanwhile."""
    import cycles.engine
    lines.clear()
    del cycles.engine.create
    editor.spaces.active.image = next(i for i in bpy.data.images if i.type == "RENDER_RESULT")
    yield from render(editor, shots=True)
    found["elsewhere"] = {"report": last_render.last_frame[0].report, "lines": sorted(set(lines), key=lines.index),
                          "samples": last_render.last_frame[0].reference_samples}
    yield from stop_elsewhere(editor, last_render, found)


bpy.context.preferences.view.show_splash = False
bpy.context.preferences.view.render_display_type = "NONE"
driver.run(session())
