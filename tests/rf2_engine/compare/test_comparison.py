# SPDX-License-Identifier: GPL-3.0-or-later
"""Two pictures are read, measured, exported and forgotten."""
import dataclasses
import json
import re
import threading
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

import addon_utils
from bl_ext.user_default.renderformer_v2.model.pictures import linear_to_srgb
from bl_ext.user_default.renderformer_v2.rf2_engine.compare import events, panel
from bl_ext.user_default.renderformer_v2.rf2_engine.compare.state import comparison
from bl_ext.user_default.renderformer_v2.rf2_engine.progress.status import Status

from tests.rf2_engine.layout import Layout
from tools.common import metrics as with_libraries

PACKAGE = "bl_ext.user_default.renderformer_v2"


def _measured():
    comparison.read()
    measurement = comparison.new_measurement()
    measurement.run()
    return measurement


def test_metrics_are_those_of_the_tools(settings):
    measured = _measured().closeness
    expected = with_libraries.compare(comparison.a.pixels[..., :3], comparison.b.pixels[..., :3])
    assert measured.psnr == pytest.approx(expected["psnr"], abs=1e-3)
    assert measured.ssim == pytest.approx(expected["ssim"], abs=1e-3)
    assert measured.flip == pytest.approx(expected["flip"], rel=5e-3)


def test_only_the_render_region_is_measured(settings, two_slots):
    two_slots.render.border_min_x, two_slots.render.border_max_x = 0.0, 0.5
    two_slots.render.border_min_y, two_slots.render.border_max_y = 0.75, 1.0
    settings.region = "BORDER"
    measured = _measured()
    assert measured.closeness.flip_map.shape == (10, 25)
    assert measured.closeness.psnr == pytest.approx(with_libraries.compare(
        comparison.a.pixels[:10, :25, :3], comparison.b.pixels[:10, :25, :3])["psnr"], abs=1e-3)
    assert measured.box.area == pytest.approx((0, 27 / 37, 0.5, 1))


def test_the_region_is_found_in_pictures_that_were_cropped_to_another(settings, two_slots):
    def select(left, right, bottom, top):
        border = two_slots.render
        border.border_min_x, border.border_max_x = left, right
        border.border_min_y, border.border_max_y = bottom, top

    def measured(*region):
        select(*region)
        return _measured()
    settings.region = "BORDER"
    whole = measured(0.3, 0.62, 0.21, 0.7)
    seen = whole.box.cut(comparison.b.pixels)
    two_slots.render.use_border = two_slots.render.use_crop_to_border = True
    select(0.1, 0.9, 0.15, 0.7)
    bpy.ops.render.render()
    settings.a.slot, settings.b.kind, settings.b.image = 2, "IMAGE", "Grey"
    bpy.data.images.new("Grey", 40, 20, float_buffer=True)
    cropped = measured(0.3, 0.62, 0.21, 0.7)  # the user selects another one afterwards
    assert comparison.a.pixels.shape[:2] == (20, 40) and cropped.box.area == pytest.approx((0.25, 0.1, 0.65, 1))
    np.testing.assert_allclose(cropped.box.cut(comparison.a.pixels), seen, atol=0.02)
    assert measured(0.1, 0.9, 0.15, 0.7).closeness.flip_map.shape == (20, 40)
    assert "7 x 7" in measured(0.91, 1, 0, 0.1).error
    two_slots.render.use_border = False
    bpy.ops.render.render()
    settings.a.slot, settings.b.kind = 1, "SLOT"
    assert measured(0.3, 0.62, 0.21, 0.7).closeness.psnr == pytest.approx(whole.closeness.psnr, abs=0.01)


def test_only_what_was_rendered_is_measured(settings, two_slots):
    whole = _measured()
    assert whole.box.is_full and "Measured" not in str(whole.notes)
    two_slots.render.use_border = True
    two_slots.render.border_min_x, two_slots.render.border_max_x = 0.0, 0.5
    two_slots.render.border_min_y, two_slots.render.border_max_y = 0.25, 1.0
    bpy.ops.render.render()
    two_slots.render.use_border = False  # the picture stays what it is
    part = _measured()
    assert part.notes[0] == "Measured: 25 x 28 pixels" and part.closeness.flip_map.shape == (28, 25)
    assert part.closeness.psnr == pytest.approx(with_libraries.compare(
        comparison.a.pixels[:28, :25, :3], comparison.b.pixels[:28, :25, :3])["psnr"], abs=1e-3)
    bpy.ops.render.render()
    assert _measured().closeness.psnr == pytest.approx(whole.closeness.psnr, abs=1e-3)


def test_clipped_values_and_alpha_are_said(settings, two_slots):
    image = bpy.data.images.new("Bright", 50, 37, float_buffer=True, alpha=True)
    pixels = np.full((37, 50, 4), (0.5, 0.5, 0.5, 1), np.float32)
    pixels[:, :5, 1], pixels[:, :10, 3] = 2, 0
    image.pixels.foreach_set(pixels.ravel())
    settings.a.kind, settings.a.image, settings.b.slot = "IMAGE", image.name, 1
    clipped, alpha = _measured().notes
    assert clipped == "Values above 1 are clipped, but for HDR-FLIP: 10.0 % of A's pixels, 0.0 % of B's"
    assert "Alpha is not in the metrics" in alpha and "0.2000 off" in alpha


def test_a_noisy_reference_is_said(settings, two_slots):
    y, x = np.mgrid[:37, :50] / 50
    clean = np.float32(0.2 + 0.3 * x + 0.2 * y)
    rough = clean + np.random.default_rng(5).normal(0, 0.05, clean.shape)
    for name, values in (("Clean", clean), ("Off", 1.15 * clean), ("Rough", rough), ("Far off", 3 * clean)):
        image = bpy.data.images.new(name, 50, 37, float_buffer=True)
        image.pixels.foreach_set(np.repeat(values[..., None], 4, -1).astype(np.float32).clip(0, 1).ravel())

    def noisy(a, b):
        for side, name in ((settings.a, a), (settings.b, b)):
            side.kind, side.image = "IMAGE", name
        return [note for note in _measured().notes if "noisy" in note]
    assert noisy("Clean", "Rough") == [
        "B is noisy: its noise is most of the difference. Give it more samples, or denoise it"]
    (said,) = noisy("Off", "Rough")
    without = -10 * np.log10(np.mean((linear_to_srgb(1.15 * clean) - linear_to_srgb(clean)) ** 2))
    assert float(re.search(r"PSNR would be about (\d+) dB", said)[1]) == pytest.approx(without, abs=1)
    assert not noisy("Rough", "Clean") and not noisy("Clean", "Off") and not noisy("Far off", "Rough")


def test_a_region_too_small_is_said(settings, two_slots):
    two_slots.render.border_max_x, two_slots.render.border_min_x = 0.1, 0.0
    settings.region = "BORDER"
    measured = _measured()
    assert measured.closeness is None and "7 x 7" in measured.error


def test_measuring_can_be_cancelled(settings):
    comparison.read()
    measurement = comparison.new_measurement()
    measurement.cancel()
    measurement.run()
    assert measurement.closeness is None and "cancelled" in measurement.error


def test_a_measurement_that_fails_says_so_and_ends(settings):
    comparison.read()
    comparison.b = dataclasses.replace(comparison.b, pixels=np.full(comparison.b.pixels.shape, None))
    measurement = comparison.new_measurement()
    measurement.start()
    measurement.wait()
    assert not measurement.is_running and "Measuring failed: TypeError" in measurement.error


def test_a_measurement_that_gets_no_thread_says_so(settings, monkeypatch):
    def refuse(thread):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", refuse)
    events.read()
    assert "could not start: can't start new thread" in comparison.measurement.error


def test_equal_sides_ask_for_another(settings):
    settings.b.slot = 1
    comparison.read()
    assert comparison.a is None and "same picture" in comparison.message


def test_the_reference_is_chosen_when_it_is_there(settings, two_slots):
    render_with_reference(two_slots)
    settings.a.kind = settings.b.kind = "SHOWN"
    comparison.read()
    assert settings.b.pass_name == "Cycles Reference"
    assert comparison.a.name == "Slot 2, ViewLayer, Combined"
    assert comparison.b.name == "Slot 2, ViewLayer, Cycles Reference"
    assert re.fullmatch(r"RenderFormer-V2, [\d.]+ s \(Slot 2, ViewLayer, Combined\)", comparison.a.label)
    assert re.fullmatch(r"Cycles, 2 samples, [\d.]+ s \(Slot 2, .*\)", comparison.b.label)
    assert comparison.a.credits.seconds != comparison.b.credits.seconds


def render_with_reference(scene):
    scene.render.engine, scene.renderformer_v2.reference.use = "RENDERFORMER_V2", True
    scene.renderformer_v2.reference.samples = 2
    bpy.ops.render.render()


def test_after_a_reference_both_are_shown_unless_the_user_does_not_want_it(settings, two_slots):
    addon, settings.show = bpy.context.preferences.addons.new(), False
    addon.module = PACKAGE
    preferences = addon.preferences
    preferences.show_reference = False
    render_with_reference(two_slots)
    assert not bpy.app.timers.is_registered(events.show_reference)
    preferences.show_reference = True
    bpy.ops.render.render()
    assert bpy.app.timers.is_registered(events.show_reference)
    bpy.app.timers.unregister(events.show_reference)
    events.show_reference()
    assert settings.show
    comparison.read()
    assert comparison.b.name == "Slot 2, ViewLayer, Cycles Reference"
    bpy.ops.renderformer_v2.compare_swap()
    events.show_reference()
    assert settings.a.pass_name == "Cycles Reference"  # the user's own sides are kept
    settings.a.kind = "SLOT"
    events.show_reference()
    assert settings.a.kind == "SLOT"  # and what is being compared
    two_slots.renderformer_v2.reference.use = False
    bpy.ops.render.render()
    assert not bpy.app.timers.is_registered(events.show_reference)


def waiting():
    """What waits for Blender to be idle, of what was asked for; it is done now."""
    actions = [a for a in (events.show_reference, events._close) if bpy.app.timers.is_registered(a)]
    for action in actions:
        bpy.app.timers.unregister(action)
        action()
    return [a.__name__.strip("_") for a in actions]


def test_what_opened_by_itself_closes_by_itself(settings, two_slots):
    settings.show = False
    render_with_reference(two_slots)
    assert waiting() == ["show_reference"] and settings.show
    render_with_reference(two_slots)
    assert waiting() == ["show_reference"] and settings.show
    two_slots.renderformer_v2.reference.use = False
    bpy.ops.render.render()
    assert waiting() == ["close"] and not settings.show
    render_with_reference(two_slots)
    assert waiting() == ["show_reference"] and settings.show
    settings.mode = "BLINK"
    two_slots.render.engine = "CYCLES"
    bpy.ops.render.render()
    assert waiting() == ["close"] and not settings.show


@pytest.mark.parametrize("choose", [lambda settings: bpy.ops.renderformer_v2.compare_swap(),
                                    lambda settings: setattr(settings, "show", True)])
def test_what_the_user_has_chosen_stays_open(settings, two_slots, choose):
    settings.show = False
    render_with_reference(two_slots)
    waiting()
    choose(settings)
    comparison.read()
    two_slots.renderformer_v2.reference.use = False
    bpy.ops.render.render()
    assert not waiting() and settings.show


def test_one_picture_alone_offers_a_reference(settings, two_slots):
    def offered():
        layout = Layout()
        panel._draw_way_out(layout, SimpleNamespace(scene=two_slots))
        return layout.operators
    two_slots.render.engine, two_slots.renderformer_v2.reference.use = "RENDERFORMER_V2", False
    settings.a.kind = settings.b.kind = "SHOWN"
    settings.a.pass_name = settings.b.pass_name = ""
    bpy.ops.render.render()
    comparison.read()
    assert comparison.has_one_picture and offered()
    assert comparison.message.startswith("A and B are the same picture: use Render Cycles Reference")
    assert bpy.ops.renderformer_v2.render_reference() and two_slots.renderformer_v2.reference.use
    comparison.read()
    assert comparison.b.name == "Slot 2, ViewLayer, Cycles Reference" and not comparison.has_one_picture
    settings.a.pass_name = "Cycles Reference"
    comparison.read()
    assert comparison.message.startswith("A and B are the same picture: choose another")  # there is a reference
    two_slots.render.engine = "CYCLES"
    assert not offered() and not bpy.ops.renderformer_v2.render_reference.poll()


def test_who_switches_a_growing_reference_off_is_not_shown_it_again(settings, two_slots):
    settings.show = False
    bpy.app.handlers.render_post.append(look := lambda *_: events.offer_reference())  # an Image Editor is drawn
    try:
        render_with_reference(two_slots)
    finally:
        bpy.app.handlers.render_post.remove(look)
    assert bpy.app.timers.is_registered(events._show_growing_reference)
    assert not bpy.app.timers.is_registered(events.show_reference)
    bpy.app.timers.unregister(events._show_growing_reference)
    events._show_growing_reference()
    assert settings.show and settings.b.pass_name == "Cycles Reference"
    events.offer_reference()
    assert not bpy.app.timers.is_registered(events._show_growing_reference)
    bpy.ops.render.render()  # in which nobody looked at the editor
    assert bpy.app.timers.is_registered(events.show_reference)
    bpy.app.timers.unregister(events.show_reference)


def test_a_reference_that_is_not_there_is_neither_compared_nor_exported(settings, two_slots, monkeypatch):
    monkeypatch.setattr(Status, "esc_pressed", lambda status: status._displayed[0].endswith("Cycles Reference"))
    render_with_reference(two_slots)
    settings.a.kind = settings.b.kind = "SHOWN"
    settings.b.pass_name = "Cycles Reference"
    comparison.read()
    assert comparison.a is None
    assert "Slot 2 has no Cycles Reference in 'ViewLayer': it was stopped" in comparison.message
    assert not bpy.ops.renderformer_v2.compare_export.poll()


def test_another_render_slot_or_region_outdates_what_was_read(settings, two_slots):
    settings.b.kind = "SHOWN"
    comparison.read()
    assert not comparison.is_outdated()
    bpy.data.images["Render Result"].render_slots.active_index = 2
    assert comparison.is_outdated()
    bpy.data.images["Render Result"].render_slots.active_index = 1
    assert not comparison.is_outdated()
    two_slots.render.border_max_x = 0.9
    assert not comparison.is_outdated()
    settings.region = "BORDER"
    comparison.read()
    two_slots.render.border_max_x = 0.8
    assert comparison.is_outdated()
    comparison.read()
    bpy.ops.render.render()
    assert comparison.is_outdated()


def test_another_number_of_slots_outdates_what_was_read(settings):
    """Where one was removed the next has its number."""
    comparison.read()
    bpy.data.images["Render Result"].render_slots.new()
    assert comparison.is_outdated()


def test_pictures_of_different_sizes_are_named(settings):
    bpy.data.images.new("Small", 20, 10)
    settings.b.kind, settings.b.image = "IMAGE", "Small"
    comparison.read()
    assert "A has 50 x 37 pixels, B 20 x 10" in comparison.message


def test_passes_that_were_read_are_suggested(settings):
    comparison.read()
    assert {("ViewLayer", "Combined"), ("ViewLayer", "Depth")} <= set(comparison.known_passes(settings.a))


def test_export_writes_a_sheet_and_numbers(settings, two_slots, tmp_path):
    two_slots.view_settings.exposure = 1
    images, before = set(bpy.data.images), two_slots.render.image_settings.file_format
    measured = _measured()
    assert bpy.ops.renderformer_v2.compare_export(filepath=str(tmp_path / "sheet.png")) == {"FINISHED"}
    numbers = json.loads((tmp_path / "sheet.json").read_text())
    assert numbers["flip"] == measured.closeness.flip and numbers["psnr"] == measured.closeness.psnr
    assert numbers["a"]["name"] == "Slot 1, ViewLayer, Combined" and (numbers["width"], numbers["height"]) == (50, 37)
    assert set(bpy.data.images) == images and two_slots.render.image_settings.file_format == before
    sheet = _pixels(tmp_path / "sheet.png")

    two_slots.render.dither_intensity = 0
    two_slots.render.image_settings.file_format = "PNG"
    bpy.data.images["Render Result"].save_render(str(tmp_path / "blender.png"), scene=two_slots)  # slot 2 is shown
    np.testing.assert_allclose(sheet[20:57, 82:132], _pixels(tmp_path / "blender.png"), atol=1.5 / 255)


@pytest.mark.parametrize("blocked, other", [("png", "json"), ("json", "png")])
def test_an_export_that_cannot_write_one_file_leaves_the_other(settings, tmp_path, blocked, other):
    comparison.read()
    (tmp_path / f"sheet.{blocked}").mkdir()
    (tmp_path / f"sheet.{other}").write_text("before")
    with pytest.raises(RuntimeError, match=f"sheet.{blocked} is a folder"):
        bpy.ops.renderformer_v2.compare_export(filepath=str(tmp_path / "sheet.png"))
    assert (tmp_path / f"sheet.{other}").read_text() == "before"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["sheet.json", "sheet.png"]


def _pixels(path):
    image = bpy.data.images.load(str(path))
    pixels = np.array(image.pixels[:]).reshape(image.size[1], image.size[0], -1)[::-1, :, :3]
    bpy.data.images.remove(image)
    return pixels


def test_exporting_nothing_is_refused(scene):
    assert not bpy.ops.renderformer_v2.compare_export.poll()


def test_the_header_switches_it_on_in_a_mode_and_off(settings):
    bpy.ops.renderformer_v2.compare(mode="DIFFERENCE")
    assert settings.show and settings.mode == "DIFFERENCE"
    bpy.ops.renderformer_v2.compare()
    assert not settings.show and comparison.a is None


def test_sides_are_swapped(settings):
    bpy.ops.renderformer_v2.compare_swap()
    assert (settings.a.slot, settings.b.slot) == (2, 1)


def test_another_file_begins_without(settings):
    comparison.read()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    addon_utils.enable(PACKAGE)
    assert comparison.a is None and not comparison.settings.show


def test_disabling_leaves_nothing_behind(scene):
    def left():
        menu = bpy.types.IMAGE_MT_editor_menus
        return ([f for f in (*bpy.app.handlers.render_complete, *bpy.app.handlers.load_post)
                 if PACKAGE in f.__module__ and ".compare" in f.__module__],
                [f for f in getattr(menu.draw, "_draw_funcs", ()) if ".compare" in f.__module__],
                [name for name in ("RENDERFORMER_PT_compare", "RENDERFORMER_MT_compare", "RENDERFORMER_GGT_split")
                 if hasattr(bpy.types, name)], hasattr(bpy.types.WindowManager, "renderformer_v2_compare"))

    assert all(left())
    addon_utils.disable(PACKAGE)
    try:
        assert not any(left())
    finally:
        addon_utils.enable(PACKAGE)
