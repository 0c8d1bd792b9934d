# SPDX-License-Identifier: GPL-3.0-or-later
"""What Cycles obeys and this engine does not is a line of the report; what makes no difference is none."""
import bpy
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine import compat
from bl_ext.user_default.renderformer_v2.rf2_engine.convert.data.report import Report
from bl_ext.user_default.renderformer_v2.rf2_engine.frame import checks, reference
from bl_ext.user_default.renderformer_v2.rf2_engine.frame.checks import report_ignored_settings
from bl_ext.user_default.renderformer_v2.rf2_engine.frame.render import summarize_lost
from bl_ext.user_default.renderformer_v2.rf2_engine.frame_settings import FrameSettings, light_passes

from tests.rf2_engine.f12 import cube, sun


@pytest.fixture
def lines(scene):
    """Function that gives the report of a cube in the sun."""
    cube(scene)
    sun(scene)

    def of_now() -> list[str]:
        report = Report()
        for data in (scene, bpy.data.lights["Sun"]):
            data.update_tag()  # a render evaluates everything
        report_ignored_settings(bpy.context.evaluated_depsgraph_get(), light_passes(scene), report)
        return report.lines()
    return of_now


def simplify(scene):
    scene.render.use_simplify = scene.cycles.use_camera_cull = True


def dice(scene):
    modifier = scene.objects["Cube"].modifiers.new("Fine", "SUBSURF")
    if hasattr(modifier, "use_adaptive_subdivision"):
        modifier.use_adaptive_subdivision = True
    else:
        scene.cycles.feature_set, scene.objects["Cube"].cycles.use_adaptive_subdivision = "EXPERIMENTAL", True


def catch_without_traced_light(scene):
    scene.renderformer_v2.light, scene.view_layers[0].cycles.use_pass_shadow_catcher = "NETWORK", True


@pytest.mark.parametrize("change, name, words", [
    (lambda scene: setattr(scene.cycles, "use_fast_gi", True), "Scene", "Fast GI"),
    (simplify, "Scene", "culling"),
    (catch_without_traced_light, "Pass Shadow Catcher", "not available"),
    (dice, "Cube", "Adaptive Subdivision"),
])
def test_a_setting_without_effect_is_said(scene, lines, change, name, words):
    assert not lines()
    change(scene)
    (line,) = lines()
    assert f" {name}: " in line and words in line


def test_the_popup_names_what_the_picture_lacks():
    report = Report()
    report.approximated("Rock", "its coat is ignored")
    report.skipped(reference.NAME, "it cannot be saved beside the frame")
    assert summarize_lost(report.entries) == ""
    for message in ("the volume is empty", "its scale is 0"):
        report.skipped("Fog", message)
    assert summarize_lost(report.entries) == "Fog is left out of the picture"
    for name in ("Tree", "Leaf", "Rock", "Moss"):
        report.refused(name, "its transform is infinite")
    assert summarize_lost(report.entries) == (
        "Fog is left out of the picture, Tree, Leaf, Rock and 1 more have data that cannot be used")


def test_without_a_denoiser_the_setting_to_raise_is_called_by_its_name(scene, monkeypatch):
    monkeypatch.setattr(compat, "has_openimagedenoise", lambda: False)
    report, scene.renderformer_v2.light = Report(), "TRACED"
    depsgraph = bpy.context.evaluated_depsgraph_get()
    checks.check(depsgraph, FrameSettings.read(depsgraph.scene_eval), report)
    label = scene.renderformer_v2.bl_rna.properties["guide_samples"].name
    assert any(f"raise {label} where some is left" in line for line in report.lines())


def test_ordinary_subdivision_needs_no_line(scene, lines):
    scene.objects["Cube"].modifiers.new("Smooth", "SUBSURF")
    scene.cycles.diffuse_bounces = 12
    assert not lines()
