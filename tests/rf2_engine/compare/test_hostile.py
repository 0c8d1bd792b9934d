# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures, names and places as nobody wishes them."""
from operator import attrgetter

import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine import compat
from bl_ext.user_default.renderformer_v2.rf2_engine.compare import sources
from bl_ext.user_default.renderformer_v2.rf2_engine.compare.state import comparison


def measured():
    comparison.read()
    assert comparison.a is not None, comparison.message
    measurement = comparison.measurement = comparison.new_measurement()
    measurement.run()
    return measurement


def export(path):
    return bpy.ops.renderformer_v2.compare_export(filepath=str(path))


def test_a_folder_that_is_not_there_is_made(settings, tmp_path):
    measured()
    assert export(tmp_path / "missing" / "sheet.png") == {"FINISHED"}
    assert {each.name for each in (tmp_path / "missing").iterdir()} == {"sheet.png", "sheet.json"}


@pytest.mark.parametrize("place", ["{}/file", "/proc"])  # no folder, and one where nobody may write
def test_a_folder_that_cannot_be_written_to_is_named(settings, tmp_path, place):
    (tmp_path / "file").write_text("no folder")
    images = set(bpy.data.images)
    measured()
    with pytest.raises(RuntimeError, match="cannot be written to .*sheet.png"):
        export(place.format(tmp_path) + "/sheet.png")
    assert [each.name for each in tmp_path.iterdir()] == ["file"] and set(bpy.data.images) == images


def test_what_lies_in_the_way_is_not_half_replaced(settings, tmp_path):
    (tmp_path / "sheet.json").mkdir()
    measured()
    with pytest.raises(RuntimeError, match="cannot be written"):
        export(tmp_path / "sheet.png")
    assert [each.name for each in tmp_path.iterdir()] == ["sheet.json"]


def test_a_name_with_a_dot_is_kept(settings, tmp_path):
    measured()
    export(tmp_path / "room.v2")
    assert {each.name for each in tmp_path.iterdir()} == {"room.v2.png", "room.v2.json"}


def test_pixels_that_are_not_numbers_are_measured_and_exported(settings, two_slots, tmp_path):
    image = bpy.data.images.new("Broken", 50, 37, float_buffer=True)
    pixels = np.full((37, 50, 4), 0.3, np.float32)
    pixels[3, 4], pixels[5, 6] = np.nan, np.inf
    image.pixels.foreach_set(pixels.ravel())
    settings.b.kind, settings.b.image = "IMAGE", image.name
    closeness = measured().closeness
    assert np.isfinite([closeness.psnr, closeness.ssim, closeness.flip]).all()
    assert export(tmp_path / "sheet.png") == {"FINISHED"}


@pytest.mark.parametrize("colorspace, alpha, expected", [("sRGB", 0.5, 0.214 * 0.5), ("Non-Color", 1.0, 0.5)])
def test_images_of_bytes_are_compared(settings, two_slots, colorspace, alpha, expected):
    image = bpy.data.images.new("Bytes", 50, 37, alpha=True)
    image.colorspace_settings.name = colorspace
    image.pixels = [0.5, 0.5, 0.5, alpha] * (50 * 37)
    settings.b.kind, settings.b.image = "IMAGE", image.name
    assert measured().closeness is not None
    assert comparison.b.pixels[0, 0, 0] == pytest.approx(expected, abs=0.004)


def test_an_image_whose_file_is_gone_is_named(settings, tmp_path):
    image = bpy.data.images.new("Lost", 4, 4)
    image.source, image.filepath = "FILE", str(tmp_path / "lost.png")
    settings.b.kind, settings.b.image = "IMAGE", image.name
    comparison.read()
    assert comparison.a is None and "'Lost' cannot be read" in comparison.message


def test_a_render_region_turned_inside_out_is_said(settings, two_slots):
    border = two_slots.render
    border.border_min_x, border.border_max_x, border.border_min_y, border.border_max_y = 1, 0, 1, 0
    settings.region = "BORDER"
    measurement = measured()
    assert measurement.closeness is not None or "7 x 7" in measurement.error


@pytest.mark.parametrize("file_format", ["PNG", "OPEN_EXR_MULTILAYER"])
def test_the_file_format_chosen_for_output_does_not_change_what_is_compared(settings, two_slots, tmp_path, file_format):
    before = sources.Reader(two_slots).picture(settings.b).pixels
    image_settings = two_slots.render.image_settings
    compat.set_file_format(image_settings, file_format)
    image_settings.color_management = "OVERRIDE"
    image_settings.linear_colorspace_settings.name = "Linear Rec.2020"
    image_settings.view_settings.exposure = 3
    kept = {key: attrgetter(key)(image_settings) for key in (
        "color_management", "linear_colorspace_settings.name", "view_settings.exposure", "view_settings.view_transform",
        "display_settings.display_device")}
    np.testing.assert_array_equal(sources.Reader(two_slots).picture(settings.b).pixels, before)
    measured()
    export(tmp_path / "sheet.png")
    assert {key: attrgetter(key)(image_settings) for key in kept} == kept


@pytest.mark.parametrize("name", ["Zwölf %d {} \\ \"x\"", "a.b.R", "日本", " "])
def test_view_layers_and_passes_may_have_any_name(settings, two_slots, name):
    layer = two_slots.view_layers[0]
    layer.name = name
    aov = layer.aovs.add()
    aov.name = name
    bpy.ops.render.render()
    settings.a.layer = layer.name
    settings.a.slot, settings.b.slot, settings.b.pass_name = 2, 2, aov.name
    comparison.read()
    assert comparison.a is not None, comparison.message
    assert (layer.name, aov.name) in comparison.known_passes(settings.b)


def test_a_picture_of_one_row_is_said_to_be_too_small(settings, two_slots):
    for name in ("One", "Two"):
        bpy.data.images.new(name, 40, 1)
    for side, name in ((settings.a, "One"), (settings.b, "Two")):
        side.kind, side.image = "IMAGE", name
    assert "7 x 7" in measured().error
