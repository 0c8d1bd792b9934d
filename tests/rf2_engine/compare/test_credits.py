# SPDX-License-Identifier: GPL-3.0-or-later
"""Engine, samples and seconds of a pass, from what is noted in a render or a file."""
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.compare import credits

BY_CYCLES = {"RenderTime": "01:02.50", "cycles.Layer.total_time": "00:30.25", "cycles.Layer.samples": "256"}
BY_US = BY_CYCLES | {"RenderFormer-V2 seconds": "7.04", "Layer.Combined.seconds": "7.04"}
WITH_REFERENCE = BY_US | {"Layer.Cycles Reference.seconds": "78.1", "Layer.Cycles Reference.samples": "256"}


def test_seconds_of_a_pass_beside_another_engines():
    assert credits.seconds(BY_CYCLES, "Layer", "Combined") == 62.5
    assert credits.seconds(BY_CYCLES, "Layer", "Cycles Reference") == 30.25
    assert credits.seconds(BY_CYCLES | {"Layer.Combined.seconds": "5.5"}, "Layer", "Combined") == 5.5
    assert credits.seconds({}, "Layer", "Combined") is None


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
    assert str(credits.of_pass(metadata, layer, name)) == expected


def test_a_reference_that_nobody_noted_is_not_there():
    assert credits.lacks_reference(BY_US, "Layer") and not credits.lacks_reference(WITH_REFERENCE, "Layer")
