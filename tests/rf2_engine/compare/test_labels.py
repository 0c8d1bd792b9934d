# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels say all where there is room, and what tells the pictures apart where there is little."""
import bpy
import numpy as np

from bl_ext.user_default.renderformer_v2.rf2_engine.compare import comparison, labels, windows
from bl_ext.user_default.renderformer_v2.rf2_engine.compare.credits import Credits
from bl_ext.user_default.renderformer_v2.rf2_engine.compare.sources import Picture

OURS, CYCLES = Credits("RenderFormer-V2", None, 7.24), Credits("Cycles", 256, 78)


def picture(credits, *place):
    return Picture(place, np.zeros((2, 2, 4), np.float32), *[windows.whole(2, 2)] * 2, credits)


def short(a, b, layered=False):
    return labels.of_pictures(a, b, layered)[-1]


def test_a_picture_and_its_reference_are_told_apart_by_their_engines():
    ours, reference = (picture(OURS, "Slot 1", "ViewLayer", "Combined"),
                       picture(CYCLES, "Slot 1", "ViewLayer", "Cycles Reference"))
    assert labels.of_pictures(ours, reference, False)[0] == (
        "RenderFormer-V2, 7.2 s (Slot 1, ViewLayer, Combined)",
        "Cycles, 256 samples, 78 s (Slot 1, ViewLayer, Cycles Reference)")
    assert short(ours, reference) == ("RenderFormer-V2, 7.2 s", "Cycles, 256 samples, 78 s")


def test_the_layer_is_named_where_there_are_several():
    ours = picture(OURS, "Slot 1", "Near", "Combined")
    reference = picture(CYCLES, "Slot 1", "Near", "Cycles Reference")
    assert short(ours, reference, layered=True) == ("RenderFormer-V2, 7.2 s (Near)", "Cycles, 256 samples, 78 s (Near)")
    composite = picture(OURS, "Slot 1", "Composite", "Combined")
    assert short(composite, reference)[0] == "RenderFormer-V2, 7.2 s (Composite)"


def test_slots_files_and_passes_are_named_where_they_differ():
    one, two = picture(OURS, "Slot 1", "ViewLayer", "Combined"), picture(CYCLES, "Slot 2", "ViewLayer", "Combined")
    assert short(one, two) == ("RenderFormer-V2, 7.2 s (Slot 1)", "Cycles, 256 samples, 78 s (Slot 2)")
    assert short(one, picture(Credits(), "photo.png")) == ("RenderFormer-V2, 7.2 s (Slot 1, ViewLayer)", "photo.png")
    assert short(one, picture(OURS, "Slot 1", "ViewLayer", "Normal")) == (
        "Slot 1, ViewLayer, Combined", "Slot 1, ViewLayer, Normal")  # the same seconds for both


def test_the_longest_that_fits_is_chosen_or_the_shortest():
    pairs = [("a longer", "b longer"), ("a", "b")]
    assert labels.longest(pairs, lambda a, b: True) == pairs[0]
    assert labels.longest(pairs, lambda a, b: len(a) < 3) == labels.longest(pairs, lambda a, b: False) == pairs[1]


def test_slots_have_the_names_that_the_header_shows(settings):
    image = bpy.data.images["Render Result"]
    image.render_slots[1].name = "With fog"
    comparison.read()
    assert comparison.b.name.startswith("With fog, ")
    image.render_slots[1].name = "Slot 2"
