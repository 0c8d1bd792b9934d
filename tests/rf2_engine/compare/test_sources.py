# SPDX-License-Identifier: GPL-3.0-or-later
"""Every pass of every slot and of loaded files is read as it was rendered, and nothing of the user's changes."""
import bpy
import numpy as np
import OpenEXR
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine import exr
from bl_ext.user_default.renderformer_v2.rf2_engine.compare import export, sources


def _channels(path):
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return {name: channel.pixels for name, channel in file.channels().items()}


def test_files_are_read_as_openexr_reads_them(save_exr):
    expected = _channels(path := save_exr("a.exr", "NONE"))
    found = exr.read(path)
    names = {f"{layer}.{of}.{channel}": pixels for (layer, of), channels in found.passes.items()
             for channel, pixels in channels.items()}
    assert names.keys() == expected.keys()
    for name, pixels in names.items():
        np.testing.assert_array_equal(pixels, expected[name])
    assert found.metadata["Scene"] == "Scene"


def test_compressed_files_and_others_are_refused(save_exr, tmp_path):
    with pytest.raises(ValueError, match="compressed"):
        exr.read(save_exr("a.exr", "ZIP"))
    (tmp_path / "text").write_bytes(b"Nothing of the kind")
    with pytest.raises(ValueError, match="EXR"):
        exr.read(tmp_path / "text")


def test_slots_are_read_whichever_is_shown(two_slots, settings):
    reader = sources.Reader(two_slots)
    a, b = reader.picture(settings.a), reader.picture(settings.b)
    assert a.pixels.shape == (37, 50, 4)
    np.testing.assert_allclose(a.pixels[..., :3], 0.25, atol=1e-6)
    assert b.pixels[0, 0] == pytest.approx([0.5, 0.6, 0.7, 1])  # the row on top has no cube
    assert np.ptp(b.pixels[18]) > 0.1
    assert a.name == "Slot 1, ViewLayer, Combined"
    assert a.credits.seconds is not None and a.credits.seconds < 60
    assert bpy.data.images["Render Result"].render_slots.active_index == 1


def test_vectors_and_values_are_shown_as_blender_shows_them(two_slots, settings):
    settings.b.pass_name = "Normal"
    front = sources.Reader(two_slots).picture(settings.b).pixels[18, 25]
    assert front == pytest.approx([0, -1, 0, 1], abs=1e-5)
    settings.b.pass_name = "Depth"
    assert sources.Reader(two_slots).picture(settings.b).pixels[18, 25] == pytest.approx([4, 4, 4, 1], abs=0.05)


@pytest.mark.parametrize("codec", ["ZIP", "PIZ", "DWAA"])
def test_loaded_multilayer_files_give_their_passes(settings, two_slots, save_exr, codec):
    path = save_exr("loaded.exr", codec)
    expected = _channels(path)
    settings.b.image, settings.b.kind = bpy.data.images.load(str(path)).name, "IMAGE"
    settings.b.pass_name = "Normal"
    found = sources.Reader(two_slots).picture(settings.b)
    np.testing.assert_array_equal(found.pixels[..., 1], expected["ViewLayer.Normal.Y"])
    assert found.name == "loaded.exr, ViewLayer, Normal"
    settings.b.pass_name = "Combined"
    assert sources.Reader(two_slots).picture(settings.b).credits.seconds is not None


def test_plain_images_are_linear(settings, two_slots):
    image = bpy.data.images.new("Plain", 50, 37)
    image.pixels = [0.5, 0.25, 0.0, 1.0] * 1850
    settings.a.kind, settings.a.image = "IMAGE", "Plain"
    assert sources.Reader(two_slots).picture(settings.a).pixels[5, 5] == pytest.approx([0.214, 0.0508, 0, 1], abs=0.003)


def test_what_is_missing_is_named(settings, two_slots):
    def message():
        with pytest.raises(sources.SourceError) as error:
            sources.Reader(two_slots).picture(settings.a)
        return str(error.value)

    settings.a.pass_name = "Mist"
    assert "Slot 1 has no pass 'Mist' in 'ViewLayer'" in message() and "Combined, Depth" in message()
    settings.a.pass_name, settings.a.layer = "Combined", "Fog"
    assert "in 'Fog'" in message()
    settings.a.layer, settings.a.slot = "", 7
    assert message() == "Slot 7 is empty: render into it first"
    settings.a.slot = 99
    assert "There is no slot 99" in message()
    settings.a.kind, settings.a.image = "IMAGE", "Gone"
    assert message() == "There is no image 'Gone'"


def test_reading_changes_no_settings(settings, two_slots):
    of_scene = two_slots.render.image_settings
    for name in ("JPEG", "OPEN_EXR"):
        with export.file_format(two_slots, name):
            before = {key: getattr(of_scene, key) for key in export.RESTORED if hasattr(of_scene, key)}
            sources.Reader(two_slots).picture(settings.a)
            assert {key: getattr(of_scene, key) for key in before} == before
