# SPDX-License-Identifier: GPL-3.0-or-later
"""Engine, samples and seconds of a pass; labels say all where there is room, and what differs where there is little."""
import bpy
import numpy as np
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.compare import pictures, slots
from bl_ext.user_default.renderformer_v2.rf2_engine.compare.pictures import Credits, Picture
from bl_ext.user_default.renderformer_v2.rf2_engine.compare.state import comparison

BY_CYCLES = {"RenderTime": "01:02.50", "cycles.Layer.total_time": "00:30.25", "cycles.Layer.samples": "256"}
BY_US = BY_CYCLES | {"RenderFormer-V2 seconds": "7.04", "Layer.Combined.seconds": "7.04"}
WITH_REFERENCE = BY_US | {"Layer.Cycles Reference.seconds": "78.1", "Layer.Cycles Reference.samples": "256"}
OURS, CYCLES = Credits("RenderFormer-V2", None, 7.24), Credits("Cycles", 256, 78)


def test_seconds_of_a_pass_beside_another_engines():
    assert pictures.read_seconds(BY_CYCLES, "Layer", "Combined") == 62.5
    assert pictures.read_seconds(BY_CYCLES, "Layer", "Cycles Reference") == 30.25
    assert pictures.read_seconds(BY_CYCLES | {"Layer.Combined.seconds": "5.5"}, "Layer", "Combined") == 5.5
    assert pictures.read_seconds({}, "Layer", "Combined") is None


@pytest.mark.parametrize("metadata, layer, name, expected", [
    (BY_CYCLES, "Layer", "Combined", "Cycles, 256 samples, 62 s"),
    (BY_CYCLES, "Composite", "Combined", "Cycles, 62 s"),
    (WITH_REFERENCE, "Layer", "Combined", "RenderFormer-V2, 7.0 s"),
    (WITH_REFERENCE, "Composite", "Combined", "RenderFormer-V2, 7.0 s"),
    (WITH_REFERENCE, "Layer", "Cycles Reference", "Cycles, 256 samples, 78 s"),
    (WITH_REFERENCE, "Layer", "Cycles Diffuse Direct", "Cycles, 256 samples, 78 s"),
    (BY_CYCLES | {"cycles.Layer.samples": "1"}, "Layer", "Combined", "Cycles, 1 sample, 62 s"),
    ({"RenderTime": "00:03.00"}, "Layer", "Combined", "3.0 s"),
    ({}, "Layer", "Combined", ""),
])
def test_credits_name_engine_samples_and_seconds(metadata, layer, name, expected):
    assert str(pictures.read_credits(metadata, layer, name)) == expected


def test_a_reference_that_nobody_noted_is_not_there():
    assert pictures.lacks_reference(BY_US, "Layer") and not pictures.lacks_reference(WITH_REFERENCE, "Layer")


def picture(credits, *path):
    return Picture(path, np.zeros((2, 2, 4), np.float32), *[slots.full(2, 2)] * 2, credits)


def short(a, b, has_layers=False):
    return pictures.label_pair(a, b, has_layers)[-1]


def test_a_picture_and_its_reference_are_told_apart_by_their_engines():
    ours, reference = (picture(OURS, "Slot 1", "ViewLayer", "Combined"),
                       picture(CYCLES, "Slot 1", "ViewLayer", "Cycles Reference"))
    assert pictures.label_pair(ours, reference, False)[0] == (
        "RenderFormer-V2, 7.2 s (Slot 1, ViewLayer, Combined)",
        "Cycles, 256 samples, 78 s (Slot 1, ViewLayer, Cycles Reference)")
    assert short(ours, reference) == ("RenderFormer-V2, 7.2 s", "Cycles, 256 samples, 78 s")


def test_the_layer_is_named_where_there_are_several():
    ours = picture(OURS, "Slot 1", "Near", "Combined")
    reference = picture(CYCLES, "Slot 1", "Near", "Cycles Reference")
    assert short(ours, reference, has_layers=True) == (
        "RenderFormer-V2, 7.2 s (Near)", "Cycles, 256 samples, 78 s (Near)")
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
    assert pictures.longest_pair(pairs, lambda a, b: True) == pairs[0]
    assert pictures.longest_pair(pairs, lambda a, b: len(a) < 3) == pairs[1]
    assert pictures.longest_pair(pairs, lambda a, b: False) == pairs[1]


def test_slots_have_the_names_that_the_header_shows(settings):
    image = bpy.data.images["Render Result"]
    image.render_slots[1].name = "With fog"
    comparison.read()
    assert comparison.b.name.startswith("With fog, ")
    image.render_slots[1].name = "Slot 2"
