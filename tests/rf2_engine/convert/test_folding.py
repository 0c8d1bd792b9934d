# SPDX-License-Identifier: GPL-3.0-or-later
"""What of a material one BSDF cannot show is reported, and nothing else is."""
import pytest

from bl_ext.user_default.renderformer_v2.rf2_engine.convert.report import Report

from tests.rf2_engine.convert.cycles_reference import empty_cycles_scene, material
from tests.rf2_engine.convert.test_material import tile_of


@pytest.fixture(autouse=True)
def scene():
    empty_cycles_scene()


def mixed(first, second, kind="ShaderNodeMixShader"):
    """Two BSDFs in a Mix or Add Shader."""
    made, tree, mix = material(kind, "Both")
    for shader, entry in zip((first, second), list(mix.inputs)[-2:], strict=True):
        tree.links.new(tree.nodes.new("ShaderNode" + shader).outputs[0], entry)
    return made


@pytest.mark.parametrize("make, message", [
    (lambda: mixed("BsdfDiffuse", "BsdfGlossy"), "folded"),
    (lambda: mixed("BsdfDiffuse", "BsdfGlass", "ShaderNodeAddShader"), "folded"),
    (lambda: mixed("BsdfDiffuse", "Emission", "ShaderNodeAddShader"), "reflects as if"),
    (lambda: material("ShaderNodeBsdfPrincipled", Emission_Strength=5.0)[0], "reflects as if"),
    (lambda: material("ShaderNodeBsdfPrincipled", Diffuse_Roughness=0.5)[0], "diffuse roughness"),
    (lambda: material("ShaderNodeBsdfDiffuse", Roughness=0.5)[0], "diffuse roughness"),
])
def test_what_one_bsdf_cannot_show_is_reported(make, message):
    report = Report()
    tile_of(make(), report)
    assert len(report.lines()) == 1 and message in report.lines()[0]


@pytest.mark.parametrize("make", [
    lambda: mixed("Emission", "BsdfTransparent"), lambda: material("ShaderNodeEmission", Strength=5.0)[0],
    lambda: material("ShaderNodeBsdfDiffuse")[0], lambda: material()[0]])
def test_what_is_shown_as_it_is_is_not_reported(make):
    report = Report()
    tile_of(make(), report)
    assert not any("folded" in line or "reflects" in line or "roughness" in line for line in report.lines())
