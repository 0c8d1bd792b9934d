# SPDX-License-Identifier: GPL-3.0-or-later
"""Of the session: the picture and its reference, while it grows, when it is stopped, and in slots."""
import bpy
import numpy as np
from driver import ESC, F12, is_rendering, middle, region
from rendering import driver, lines, render, stages


def both(comparison, found):
    """Nothing was chosen, and the picture and its reference are seen; a button shows one alone."""
    chosen = comparison.settings
    yield lambda: comparison.a is not None
    found["both"] = [chosen.show, chosen.mode, comparison.a.label, comparison.b.label]
    found["button"] = []
    for _ in range(2):
        bpy.ops.renderformer_v2.compare()
        yield 0.5
        found["button"].append(chosen.show)


def stop_reference(editor, comparison, last_render, found, region_of_frame=None):
    """It is seen while it grows, also in a render region, one button hides it, and Esc keeps its samples."""
    name = "region" if region_of_frame else "reference"
    render = bpy.context.scene.render
    if region_of_frame:
        render.use_border = True
        render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = region_of_frame
    from bl_ext.user_default.renderformer_v2.rf2_engine.compare.growing import growing_reference
    from bl_ext.user_default.renderformer_v2.rf2_engine.cycles import growing as of_cycles
    reference = bpy.context.scene.renderformer_v2.reference
    chosen, reference.samples, samples = comparison.settings, 1 << 20, []
    chosen.mode, chosen.split = "SPLIT", 0.5
    driver.move(*middle(region(editor)))
    driver.key(F12)
    yield lambda: of_cycles.running() is not None and growing_reference.picture is not None
    for number in range(2):
        yield 2.5
        samples.append(of_cycles.running().samples())
        driver.shot(f"{name}_grows_{number}")
    found[f"{name}_buttons"] = [chosen.show]
    for _ in range(2):
        bpy.ops.renderformer_v2.compare()
        yield 1.5
        driver.shot(f"{name}_grows_and_{'both' if chosen.show else 'one'}")
        found[f"{name}_buttons"].append(chosen.show)
    with growing_reference.picture.bind():
        import gpu
        width, height = growing_reference.picture.width, growing_reference.picture.height
        pixels = gpu.state.active_framebuffer_get().read_color(0, 0, width, height, 4, 0, "FLOAT")
        pixels.dimensions = width * height * 4
        grown = np.array(pixels, np.float32).reshape(height, width, 4)[::-1]
    driver.key(ESC)
    yield lambda: not is_rendering()
    yield lambda: comparison.a is not None and "samples" in comparison.b.label
    yield 1.0
    driver.shot(f"{name}_stopped")
    (last,) = last_render.last_frame
    found[f"{name}_stopped"] = [samples, last.reference_samples, last.report, comparison.b.label,
                                growing_reference.picture is None]
    box = comparison.b.rendered
    rows = comparison.b.pixels.shape[0]
    rendered = comparison.b.pixels[rows - box.top:rows - box.bottom, box.left:box.right]
    found[f"{name}_grown_off"] = float(np.abs(grown - rendered)[..., :3].mean() / rendered.mean())
    reference.samples, render.use_border = 64, False


def slots(editor, comparison, last_render, found):
    """Cycles in another slot leaves Last Render, and both slots are compared."""
    scene, chosen = bpy.context.scene, comparison.settings
    image = next(i for i in bpy.data.images if i.type == "RENDER_RESULT")
    before = list(last_render.last_frame)
    image.render_slots.active_index = 1
    scene.render.engine, scene.cycles.samples = "CYCLES", 16
    yield from render(editor)
    scene.render.engine, image.render_slots.active_index = "RENDERFORMER_V2", 0
    for side, slot in ((chosen.a, 1), (chosen.b, 2)):
        side.kind, side.slot, side.pass_name, side.layer = "SLOT", slot, "Combined", ""
    chosen.show = True
    yield lambda: comparison.a is not None and "Slot 2" in comparison.b.name
    yield 1.0
    driver.shot("slots")
    found["slots"] = [last_render.last_frame == before, comparison.a.label, comparison.b.label]
    for side, name in ((chosen.a, ""), (chosen.b, "Cycles Reference")):
        side.kind, side.pass_name = "SHOWN", name
    chosen.show = False


def stop_elsewhere(editor, last_render, found):
    """Esc makes the Blender in the background hand over what it has."""
    reference = bpy.context.scene.renderformer_v2.reference
    reference.samples = 1 << 20
    stages.clear()
    lines.clear()
    driver.move(*middle(region(editor)))
    driver.key(F12)
    yield lambda: "Cycles Reference" in stages and any("Cycles 0 %" in line or "Cycles 1 %" in line for line in lines)
    yield 10.0
    driver.key(ESC)
    yield lambda: not is_rendering()
    yield 1.0
    driver.shot("stopped_in_the_background")
    found["elsewhere_stopped"] = [last_render.last_frame[0].reference_samples, last_render.last_frame[0].report]
